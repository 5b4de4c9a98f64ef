//! Messages as the middleware wants them: a transparent wrapper with the message's versioned name.
//!
//! In and out: any [`Message`] of `contract`, which thereby stays free of the middleware. No conversion happens:
//! the bytes in shared memory are the message.
#![allow(unsafe_code, reason = "the wrapper promises the middleware what `Message` already guarantees")]

use bytemuck::TransparentWrapper;
use iceoryx2::prelude::ZeroCopySend;
use tsense_contract::Message;

/// A message in shared memory.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub struct Wire<M: Message>(pub M);

// SAFETY: `#[repr(transparent)]` over its only field.
unsafe impl<M: Message> TransparentWrapper<M> for Wire<M> {}

// SAFETY: a `Message` is `Pod`: no pointers, no padding, every bit pattern valid, layout fixed by `repr(C)`. The name
// carries the version, and a golden file guards the layout behind it.
unsafe impl<M: Message> ZeroCopySend for Wire<M> {
    unsafe fn type_name() -> &'static str {
        M::TYPE_NAME
    }
}

impl<M: Message> Default for Wire<M> {
    fn default() -> Self {
        Self(M::zeroed())
    }
}
