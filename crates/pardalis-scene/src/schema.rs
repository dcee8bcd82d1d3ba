//! JSON schemas of files, for editors.

use serde_json::{Map, Value, json};

use super::description::{Content, KeyDescription, Presence, Range, Type};
use super::keys::{inside, keys_in, name_in};

/// Returns the schema of a file with these keys.
pub(super) fn of(title: &str, keys: &[KeyDescription]) -> String {
    let mut schema = table(keys, "");
    schema.insert(
        "$schema".to_owned(),
        "https://json-schema.org/draft/2020-12/schema".into(),
    );
    schema.insert("title".to_owned(), title.into());
    let mut text = format!("{:#}", Value::Object(schema));
    text.push('\n');
    text
}

fn table(keys: &[KeyDescription], path: &str) -> Map<String, Value> {
    let mut properties = Map::new();
    let mut required = Vec::new();
    for key in keys_in(keys, path) {
        let name = name_in(&key.path, path).unwrap_or_default();
        let mut property = content(keys, key);
        property.insert("description".to_owned(), described(key).into());
        if let Presence::Default(value) = &key.presence
            && let Ok(value) = serde_json::to_value(value)
        {
            property.insert("default".to_owned(), value);
        }
        if key.presence == Presence::Required {
            required.push(name);
        }
        properties.insert(name.to_owned(), Value::Object(property));
    }
    let schema = json!({
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    });
    map(schema)
}

/// Returns the meaning of a key, including what a schema cannot express.
fn described(key: &KeyDescription) -> String {
    let mut sentences = vec![key.about.to_owned()];
    if let Content::Value { unit, .. } = key.content
        && !unit.is_empty()
    {
        sentences.push(format!("Unit: {unit}."));
    }
    match key.presence {
        Presence::RequiredIf(condition) => sentences.push(format!("Required {condition}.")),
        Presence::Optional(otherwise) | Presence::DefaultDepends(otherwise)
            if !otherwise.is_empty() =>
        {
            sentences.push(format!("Default: {otherwise}."));
        }
        _ => {}
    }
    sentences.join(" ")
}

fn content(keys: &[KeyDescription], key: &KeyDescription) -> Map<String, Value> {
    match &key.content {
        Content::Value { kind, range, .. } => map(value(kind, *range)),
        Content::Table => table(keys, &key.path),
        Content::Choice => {
            let mut schema = table(keys, &key.path);
            schema.insert("minProperties".to_owned(), 1.into());
            schema.insert("maxProperties".to_owned(), 1.into());
            schema
        }
        Content::Named => map(json!({
            "type": "object",
            "patternProperties": { "^[A-Za-z0-9_-]{1,64}$": table(keys, &inside(key)) },
            "additionalProperties": false,
            "minProperties": 1,
        })),
        Content::List => map(json!({ "type": "array", "items": table(keys, &key.path) })),
    }
}

fn value(kind: &Type, range: Option<Range>) -> Value {
    match kind {
        Type::Number => bounded(json!({ "type": "number" }), range),
        Type::Integer(least, greatest) => {
            let mut schema = map(json!({ "type": "integer" }));
            // The limits of 64-bit integers are not restrictions.
            if *least > i64::MIN {
                schema.insert("minimum".to_owned(), (*least).into());
            }
            if *greatest < i64::MAX {
                schema.insert("maximum".to_owned(), (*greatest).into());
            }
            bounded(Value::Object(schema), range)
        }
        Type::Boolean => json!({ "type": "boolean" }),
        Type::Text => json!({ "type": "string" }),
        Type::Words(words) => json!({ "enum": words }),
        Type::List(item, None) => json!({ "type": "array", "items": value(item, range) }),
        Type::List(item, Some(count)) => json!({
            "type": "array",
            "items": value(item, range),
            "minItems": count,
            "maxItems": count,
        }),
        Type::Either(a, b) => json!({ "anyOf": [value(a, range), value(b, range)] }),
        Type::Any => json!({}),
        Type::Map(item) => {
            json!({ "type": "object", "additionalProperties": value(item, range) })
        }
    }
}

fn bounded(schema: Value, range: Option<Range>) -> Value {
    let mut schema = map(schema);
    if let Some(range) = range {
        let name = if range.above {
            "exclusiveMinimum"
        } else {
            "minimum"
        };
        schema.insert(name.to_owned(), number(range.least));
        if range.greatest.is_finite() {
            let name = if range.below {
                "exclusiveMaximum"
            } else {
                "maximum"
            };
            schema.insert(name.to_owned(), number(range.greatest));
        }
    }
    Value::Object(schema)
}

/// Converts a bound without a fraction to an integer.
fn number(bound: f64) -> Value {
    if bound.fract() == 0.0 && bound.abs() < 1e15 {
        (bound as i64).into()
    } else {
        bound.into()
    }
}

fn map(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}
