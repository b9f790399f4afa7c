//! Encoding of units and of the library's enums in messages.

use postcard_schema::Schema;
use postcard_schema::schema::{DataModelType, DataModelVariant, NamedType, NamedVariant};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{AdcCode, MetresPerSecondSquared, MillimetresPerSecond, Newton, Provenance, Volt};

/// Encodes a unit in messages as the number that it wraps.
macro_rules! transparent {
    ($($unit:ident($inner:ty)),* $(,)?) => {$(
        impl Serialize for $unit {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_newtype_struct(stringify!($unit), &self.0)
            }
        }

        impl<'de> Deserialize<'de> for $unit {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                <$inner>::deserialize(deserializer).map(Self)
            }
        }

        impl Schema for $unit {
            const SCHEMA: &'static NamedType = &NamedType {
                name: stringify!($unit),
                ty: &DataModelType::NewtypeStruct(<$inner as Schema>::SCHEMA),
            };
        }
    )*};
}

transparent! {
    AdcCode(u16),
    Volt(f32),
    Newton(f32),
    MillimetresPerSecond(f32),
    MetresPerSecondSquared(f32),
}

/// Implements the schema of an enum without fields. Variants must be in the order of their numbers in messages.
macro_rules! plain_enum {
    ($name:ident { $($variant:ident),* $(,)? }) => {
        impl Schema for $name {
            const SCHEMA: &'static NamedType = &NamedType {
                name: stringify!($name),
                ty: &DataModelType::Enum(&[$(
                    &NamedVariant {
                        name: stringify!($variant),
                        ty: &DataModelVariant::UnitVariant,
                    },
                )*]),
            };
        }

        #[cfg(test)]
        const _: fn($name) = |value| match value {
            $($name::$variant => (),)*
        };
    };
}

plain_enum!(Provenance {
    Recorded,
    Simulated,
    Unscaled
});

#[cfg(test)]
mod tests {
    use super::*;

    fn index<T: Serialize>(value: T) -> u8 {
        let mut bytes = [0; 4];
        let used = postcard::to_slice(&value, &mut bytes).expect("a variant's number fits");
        assert_eq!(used.len(), 1);
        used[0]
    }

    #[test]
    fn schemas_name_variants_in_the_order_of_the_wire() {
        let all = [Provenance::Recorded, Provenance::Simulated, Provenance::Unscaled];
        assert_eq!(all.map(index), [0, 1, 2]);
    }
}
