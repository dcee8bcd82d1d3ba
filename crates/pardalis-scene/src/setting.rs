//! The types of settings: how each is read from a TOML value, and what is allowed.

use toml::de::DeValue;

/// A type of settings.
pub(super) trait Setting: Sized {
    /// What is allowed, in words.
    const ALLOWED: &'static str;
    /// The same for a list of them.
    const LIST: &'static str = "a list";
    fn read(value: &DeValue) -> Option<Self>;
    fn write(&self) -> toml::Value;
}

impl Setting for f64 {
    const ALLOWED: &'static str = "a finite number";
    const LIST: &'static str = "a list of finite numbers";
    fn read(value: &DeValue) -> Option<Self> {
        let number: f64 = match value {
            DeValue::Float(float) => float.as_str().replace('_', "").parse().ok()?,
            DeValue::Integer(_) => i64::read(value)? as f64,
            _ => return None,
        };
        number.is_finite().then_some(number)
    }
    fn write(&self) -> toml::Value {
        toml::Value::Float(*self)
    }
}

impl Setting for bool {
    const ALLOWED: &'static str = "true or false";
    fn read(value: &DeValue) -> Option<Self> {
        match value {
            DeValue::Boolean(value) => Some(*value),
            _ => None,
        }
    }
    fn write(&self) -> toml::Value {
        toml::Value::Boolean(*self)
    }
}

impl Setting for i64 {
    const ALLOWED: &'static str = "a whole number";
    fn read(value: &DeValue) -> Option<Self> {
        let DeValue::Integer(integer) = value else {
            return None;
        };
        Self::from_str_radix(&integer.as_str().replace('_', ""), integer.radix()).ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Integer(*self)
    }
}

impl Setting for usize {
    const ALLOWED: &'static str = "a whole number, 0 or more";
    const LIST: &'static str = "a list of whole numbers, 0 or more";
    fn read(value: &DeValue) -> Option<Self> {
        i64::read(value)?.try_into().ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Integer(i64::try_from(*self).unwrap_or(i64::MAX))
    }
}

impl Setting for u32 {
    const ALLOWED: &'static str = "a whole number from 0 to 4294967295";
    fn read(value: &DeValue) -> Option<Self> {
        i64::read(value)?.try_into().ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Integer(i64::from(*self))
    }
}

impl Setting for String {
    const ALLOWED: &'static str = "a text in quotes";
    const LIST: &'static str = "a list of texts";
    fn read(value: &DeValue) -> Option<Self> {
        value.as_str().map(str::to_owned)
    }
    fn write(&self) -> toml::Value {
        toml::Value::String(self.clone())
    }
}

impl<T: Setting> Setting for Vec<T> {
    const ALLOWED: &'static str = T::LIST;
    const LIST: &'static str = "a list of rows of finite numbers";
    fn read(value: &DeValue) -> Option<Self> {
        value
            .as_array()?
            .iter()
            .map(|item| T::read(item.get_ref()))
            .collect()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Array(self.iter().map(Setting::write).collect())
    }
}

impl<const N: usize> Setting for [f64; N] {
    const ALLOWED: &'static str = match N {
        2 => "two finite numbers, [a, b]",
        3 => "three finite numbers, [a, b, c]",
        4 => "four finite numbers, [a, b, c, d]",
        5 => "five finite numbers, [a, b, c, d, e]",
        6 => "six finite numbers, [xx, xy, xz, yy, yz, zz]",
        _ => "a list of finite numbers",
    };
    const LIST: &'static str = match N {
        4 => "a list of points of four finite numbers, [[u, v, x, y], ...]",
        _ => "a list of rows of finite numbers",
    };
    fn read(value: &DeValue) -> Option<Self> {
        Vec::<f64>::read(value)?.try_into().ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Array(self.iter().map(Setting::write).collect())
    }
}

impl<const ROWS: usize, const COLUMNS: usize> Setting for [[f64; COLUMNS]; ROWS] {
    const ALLOWED: &'static str = match (ROWS, COLUMNS) {
        (3, 3) => "three rows of three finite numbers",
        (4, 2) => "four points of two finite numbers, [[x, y], ...]",
        (4, 4) => "four rows of four finite numbers",
        _ => "rows of finite numbers",
    };
    fn read(value: &DeValue) -> Option<Self> {
        let rows: Vec<[f64; COLUMNS]> = value
            .as_array()?
            .iter()
            .map(|row| <[f64; COLUMNS]>::read(row.get_ref()))
            .collect::<Option<_>>()?;
        rows.try_into().ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Array(self.iter().map(Setting::write).collect())
    }
}

/// One number for all three axes, or three.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PerAxis(pub(super) [f64; 3]);

impl Setting for PerAxis {
    const ALLOWED: &'static str = "a finite number, or three of them, [x, y, z]";
    fn read(value: &DeValue) -> Option<Self> {
        f64::read(value)
            .map(|v| [v; 3])
            .or_else(|| <[f64; 3]>::read(value))
            .map(Self)
    }
    fn write(&self) -> toml::Value {
        self.0.write()
    }
}
