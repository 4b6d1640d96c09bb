//! What an input file may hold, as JSON Schema (draft 7): editors complete and check by it. Every form of a table says its schema
//! beside the code that reads it, in these words. A schema knows keys, types, words and ranges; what hangs on other files or on
//! several values together is the program's to check.

use serde_json::{Map, Value, json};

/// A key of a table.
pub struct Key {
    name: &'static str,
    required: bool,
    schema: Value,
}

pub fn required(name: &'static str, schema: Value) -> Key {
    Key { name, required: true, schema }
}

pub fn optional(name: &'static str, schema: Value) -> Key {
    Key { name, required: false, schema }
}

/// A table with these keys and no others.
pub fn table(keys: impl IntoIterator<Item = Key>) -> Value {
    let mut properties = Map::new();
    let mut needed = Vec::new();
    for key in keys {
        if key.required {
            needed.push(key.name);
        }
        properties.insert(key.name.to_owned(), key.schema);
    }
    let mut schema = json!({ "type": "object", "properties": properties, "additionalProperties": false });
    if !needed.is_empty() {
        schema["required"] = json!(needed);
    }
    schema
}

/// A table with exactly one of `choices`, beside `others`.
pub fn one_key(
    choices: impl IntoIterator<Item = (&'static str, Value)>,
    others: impl IntoIterator<Item = Key>,
) -> Value {
    let (mut keys, mut exactly_one): (Vec<Key>, Vec<Value>) = (Vec::new(), Vec::new());
    for (name, schema) in choices {
        exactly_one.push(json!({ "required": [name] }));
        keys.push(optional(name, schema));
    }
    keys.extend(others);
    let mut schema = table(keys);
    schema["oneOf"] = Value::Array(exactly_one);
    schema
}

/// Tables under names that the file chooses.
pub fn named(schema: Value) -> Value {
    json!({ "type": "object", "additionalProperties": schema })
}

pub fn list(item: Value) -> Value {
    json!({ "type": "array", "items": item })
}

/// A list with at least one item.
pub fn some(item: Value) -> Value {
    json!({ "type": "array", "items": item, "minItems": 1 })
}

/// A list of exactly so many.
pub fn exactly(count: usize, item: Value) -> Value {
    json!({ "type": "array", "items": item, "minItems": count, "maxItems": count })
}

pub fn text() -> Value {
    json!({ "type": "string" })
}

/// One of these words.
pub fn word<'w>(words: impl IntoIterator<Item = &'w str>) -> Value {
    json!({ "type": "string", "enum": words.into_iter().collect::<Vec<_>>() })
}

pub fn flag() -> Value {
    json!({ "type": "boolean" })
}

pub fn number() -> Value {
    json!({ "type": "number" })
}

pub fn above(least: f64) -> Value {
    json!({ "type": "number", "exclusiveMinimum": least })
}

pub fn at_least(least: f64) -> Value {
    json!({ "type": "number", "minimum": least })
}

/// A number in a closed range.
pub fn between(least: f64, most: f64) -> Value {
    json!({ "type": "number", "minimum": least, "maximum": most })
}

/// A whole number in a closed range.
pub fn whole(least: u64, most: u64) -> Value {
    json!({ "type": "integer", "minimum": least, "maximum": most })
}

/// A whole number from `least` on.
pub fn whole_from(least: u64) -> Value {
    json!({ "type": "integer", "minimum": least })
}

/// Three numbers: a place, a direction.
pub fn vector() -> Value {
    exactly(3, number())
}

/// Three numbers, none negative: a radiance, an intensity.
pub fn colour() -> Value {
    exactly(3, at_least(0.0))
}

/// Any of several forms.
pub fn either(forms: impl IntoIterator<Item = Value>) -> Value {
    json!({ "anyOf": forms.into_iter().collect::<Vec<_>>() })
}

/// The same with words for the reader.
pub fn described(mut schema: Value, description: &str) -> Value {
    schema["description"] = json!(description);
    schema
}

/// The same with what holds where the key is left out.
pub fn default(mut schema: Value, value: impl Into<Value>) -> Value {
    schema["default"] = value.into();
    schema
}

/// A form that stands among the document's definitions under this name.
pub fn defined(name: &str) -> Value {
    json!({ "$ref": format!("#/definitions/{name}") })
}

/// A whole file.
pub fn document(title: &str, mut schema: Value) -> Value {
    let mut document = json!({ "$schema": "http://json-schema.org/draft-07/schema#", "title": title });
    if let (Some(all), Some(own)) = (document.as_object_mut(), schema.as_object_mut()) {
        all.append(own);
    }
    document
}
