//! Shapes that repeat: records, messages of mandatory fields, and those with a presence vector.

/// Structs whose fields all travel, one after the other.
macro_rules! records {
    ($($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $kind:ty,)* })+) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $name { $($(#[$field_doc])* pub $field: $kind,)* }

        impl $crate::message::Field for $name {
            fn read(_reader: &mut $crate::Reader<'_>) -> Result<Self, $crate::Malformed> {
                Ok(Self { $($field: <$kind as $crate::message::Field>::read(_reader)?,)* })
            }
            fn write(&self, _out: &mut $crate::Writer) {
                $(<$kind as $crate::message::Field>::write(&self.$field, _out);)*
            }
        }
    )+};
}

/// Messages whose fields all travel.
macro_rules! messages {
    ($($(#[$doc:meta])* $name:ident = $code:literal { $($(#[$field_doc:meta])* $field:ident: $kind:ty,)* })+) => {
        $(
            records! { $(#[$doc])* $name { $($(#[$field_doc])* $field: $kind,)* } }
            message_of_field! { $name = $code }
        )+
    };
}

/// A message that is a field with a code before it.
macro_rules! message_of_field {
    ($name:ident = $code:literal) => {
        impl $crate::Message for $name {
            const CODE: u16 = $code;
            fn read(reader: &mut $crate::Reader<'_>) -> Result<Self, $crate::Malformed> {
                <Self as $crate::message::Field>::read(reader)
            }
            fn write(&self, out: &mut $crate::Writer) {
                <Self as $crate::message::Field>::write(self, out);
            }
        }
    };
}

/// Structs behind a presence vector: a bit for each `may` field in order, none for a `must` field.
macro_rules! presence {
    ($($(#[$doc:meta])* $name:ident: $bits:ident {
        $($(#[$field_doc:meta])* $need:ident $field:ident: $kind:ty,)+
    })+) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $name { $($(#[$field_doc])* pub $field: presence!(@type $need $kind),)+ }

        impl $crate::message::Field for $name {
            #[allow(unused_assignments, reason = "the last field moves the bit once more")]
            fn read(reader: &mut $crate::Reader<'_>) -> Result<Self, $crate::Malformed> {
                let mut present = reader.$bits()?;
                $(let $field = presence!(@read $need $kind, reader, present);)+
                // A bit that names no field is a message we cannot read.
                if present == 0 { Ok(Self { $($field,)+ }) } else { Err($crate::Malformed::Value) }
            }
            #[allow(unused_assignments, reason = "the last field moves the bit once more")]
            fn write(&self, out: &mut $crate::Writer) {
                let (mut present, mut bit): ($bits, $bits) = (0, 1);
                $(presence!(@note $need self.$field, present, bit);)+
                out.$bits(present);
                $(presence!(@write $need $kind, self.$field, out);)+
            }
        }
    )+};
    (@type may $kind:ty) => { Option<$kind> };
    (@type must $kind:ty) => { $kind };
    (@read may $kind:ty, $reader:ident, $present:ident) => {{
        let here = $present & 1 == 1;
        $present >>= 1;
        if here { Some(<$kind as $crate::message::Field>::read($reader)?) } else { None }
    }};
    (@read must $kind:ty, $reader:ident, $present:ident) => { <$kind as $crate::message::Field>::read($reader)? };
    (@note may $field:expr, $present:ident, $bit:ident) => {
        if $field.is_some() {
            $present |= $bit;
        }
        $bit <<= 1;
    };
    (@note must $field:expr, $present:ident, $bit:ident) => {};
    (@write may $kind:ty, $field:expr, $out:ident) => {
        if let Some(value) = &$field {
            <$kind as $crate::message::Field>::write(value, $out);
        }
    };
    (@write must $kind:ty, $field:expr, $out:ident) => { <$kind as $crate::message::Field>::write(&$field, $out); };
}
