//! What the shells of several drivers share: opening and moving bytes. Only shells use it.

pub(crate) mod line;
