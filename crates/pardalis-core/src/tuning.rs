//! Structs of tuned constants.

/// Defines a struct of tuned constants. Each has documentation, a type, a default, a unit and an origin: how the value
/// was chosen. The unit is `"share"` for probabilities and shares.
///
/// ```
/// pardalis_core::tuned! {
///     /// How candidates are searched.
///     SearchTuning {
///         /// The number kept.
///         most: usize = 8, "candidates", "hand-set";
///     }
/// }
/// assert_eq!(SearchTuning::default().most, 8);
/// ```
#[macro_export]
macro_rules! tuned {
    (
        $(#[$about:meta])*
        $name:ident {
            $($(#[$about_field:meta])* $field:ident: $type:ty = $default:expr, $unit:literal, $origin:literal;)*
        }
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[non_exhaustive]
        pub struct $name {
            $(
                $(#[$about_field])*
                ///
                #[doc = concat!("Unit: ", $unit, ". Default: ", stringify!($default), ". Origin: ", $origin, ".")]
                pub $field: $type,
            )*
        }

        impl $name {
            /// The defaults.
            pub const DEFAULT: Self = Self { $($field: $default,)* };

            /// Calls `visit` with each constant's name, unit and value, which it may change. Counts are rounded down.
            #[allow(clippy::unnecessary_cast)] // one conversion for all types of numbers
            pub fn visit(&mut self, visit: &mut dyn FnMut(&'static str, &'static str, &mut f64)) {
                $(
                    let mut value = self.$field as f64;
                    visit(stringify!($field), $unit, &mut value);
                    self.$field = value as $type;
                )*
            }

            /// Returns an error unless every constant is above 0 and at most 10 000, or 1 for shares.
            pub fn check(&self) -> Result<(), $crate::Error> {
                let mut result = Ok(());
                let mut checked = *self;
                checked.visit(&mut |name, unit, value| {
                    let (most, allowed) = if unit == "share" {
                        (1.0, "above 0 and at most 1")
                    } else {
                        (10_000.0, "above 0 and at most 10000")
                    };
                    if !(*value > 0.0 && *value <= most) && result.is_ok() {
                        result = Err($crate::Error::out_of_range(name, *value, allowed));
                    }
                });
                result
            }
        }

        impl Default for $name {
            fn default() -> Self {
                Self::DEFAULT
            }
        }
    };
}

#[cfg(test)]
#[allow(unreachable_pub)] // the macro defines public structs
mod tests {
    crate::tuned! {
        /// An example.
        ExampleTuning {
            /// A count.
            count: usize = 5, "things", "hand-set";
            /// A probability.
            chance: f32 = 0.25, "share", "hand-set";
        }
    }

    #[test]
    fn constants_are_visited_by_name_and_can_be_changed() {
        let mut tuning = ExampleTuning::default();
        let mut seen = Vec::new();
        tuning.visit(&mut |name, unit, value| {
            seen.push((name, unit, *value));
            *value *= 0.5;
        });
        assert_eq!(seen, [("count", "things", 5.0), ("chance", "share", 0.25)]);
        assert_eq!((tuning.count, tuning.chance), (2, 0.125));
    }

    #[test]
    fn constants_out_of_range_are_refused_by_name() {
        assert!(ExampleTuning::DEFAULT.check().is_ok());
        for (count, chance, name) in [
            (0, 0.25, "count"),
            (10_001, 0.25, "count"),
            (5, 1.5, "chance"),
            (5, f32::NAN, "chance"),
        ] {
            let error = ExampleTuning { count, chance }.check().unwrap_err();
            assert!(error.to_string().contains(name), "{error}");
        }
    }
}
