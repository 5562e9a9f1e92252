//! The layout of safetensors: eight bytes of header length (little-endian), a JSON header that places every tensor, the values.

use serde_json::{Map, Value};

/// Headers beyond this are nobody's network: bounds the memory that a hostile file can ask for.
const LONGEST_HEADER: u64 = 16 << 20;

/// Header and values of a safetensors file, or what is wrong with it.
pub(crate) fn split(bytes: &[u8]) -> Result<(Map<String, Value>, &[u8]), String> {
    let Some((length, rest)) = bytes.split_first_chunk::<8>() else {
        return Err(format!("a file of {} bytes", bytes.len()));
    };
    let length = u64::from_le_bytes(*length);
    if length > LONGEST_HEADER {
        return Err("something else (no safetensors header)".to_owned());
    }
    let Some((header, data)) = rest.split_at_checked(length as usize) else {
        return Err("one that was cut short in its header".to_owned());
    };
    match serde_json::from_slice(header) {
        Ok(Value::Object(header)) => Ok((header, data)),
        _ => Err("something else (no safetensors header)".to_owned()),
    }
}

/// The values of one tensor of a safetensors file (F32 only).
pub(crate) fn tensor_values<'a>(
    header: &Map<String, Value>,
    data: &'a [u8],
    name: &str,
    shape: &[usize],
) -> Result<impl Iterator<Item = f32> + use<'a>, String> {
    Ok(tensor_bytes(header, data, name, shape, "F32", 4)?
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
}

/// The bytes of one tensor of a safetensors file, whose values have this type and size.
pub(crate) fn tensor_bytes<'a>(
    header: &Map<String, Value>,
    data: &'a [u8],
    name: &str,
    shape: &[usize],
    dtype: &str,
    size: usize,
) -> Result<&'a [u8], String> {
    let Some(entry) = header.get(name) else {
        return Err(format!("expected the tensor {name:?}, but found none"));
    };
    let numbers =
        |key: &str| -> Option<Vec<u64>> { entry.get(key)?.as_array()?.iter().map(Value::as_u64).collect() };
    let found = numbers("shape").unwrap_or_default();
    if !found.iter().copied().eq(shape.iter().map(|size| *size as u64)) {
        return Err(format!(
            "tensor {name:?}: expected the shape {shape:?}, but found {found:?}"
        ));
    }
    if entry.get("dtype").and_then(Value::as_str) != Some(dtype) {
        return Err(format!(
            "tensor {name:?}: expected {dtype}, but found {}",
            entry.get("dtype").unwrap_or(&Value::Null)
        ));
    }
    let bytes = match numbers("data_offsets").as_deref() {
        Some([start, end]) => usize::try_from(*start)
            .ok()
            .zip(usize::try_from(*end).ok())
            .and_then(|(start, end)| data.get(start..end)),
        _ => None,
    };
    match bytes {
        Some(bytes) if bytes.len() == size * shape.iter().product::<usize>() => Ok(bytes),
        _ => Err(format!(
            "tensor {name:?}: its values are missing: the file was cut short"
        )),
    }
}
