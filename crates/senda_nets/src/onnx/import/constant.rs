//! Constants of a graph: weights and shapes.

use super::super::*;

/// A tensor that does not depend on the input.
#[derive(Debug, Clone)]
pub(super) struct Constant {
    pub(super) shape: Vec<usize>,
    pub(super) floats: Vec<f32>,
    pub(super) wholes: Vec<i64>,
}

impl Constant {
    pub(super) fn new(tensor: &TensorProto) -> Result<Self, String> {
        if tensor.data_location == 1 {
            return Err(format!(
                "values of {:?} in another file; save the model as one file",
                tensor.name
            ));
        }
        let shape: Option<Vec<usize>> = tensor
            .dims
            .iter()
            .map(|size| usize::try_from(*size).ok())
            .collect();
        let shape = shape.ok_or_else(|| format!("a negative size in {:?}", tensor.name))?;
        let (mut floats, mut wholes) = (tensor.float_data.clone(), tensor.int64_data.clone());
        if !tensor.raw_data.is_empty() {
            match tensor.data_type {
                FLOAT => {
                    let words = tensor.raw_data.chunks_exact(4);
                    floats = words
                        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                        .collect();
                }
                INT64 => {
                    let words = tensor.raw_data.chunks_exact(8);
                    wholes = words
                        .map(|b| i64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]))
                        .collect();
                }
                _ => {}
            }
        }
        let count = shape
            .iter()
            .try_fold(1usize, |product, size| product.checked_mul(*size));
        let len = match tensor.data_type {
            FLOAT => floats.len(),
            INT64 => wholes.len(),
            // Other types may stand in nodes that are not used; whoever needs them complains.
            _ => {
                return Ok(Self {
                    shape,
                    floats: Vec::new(),
                    wholes: Vec::new(),
                });
            }
        };
        if count != Some(len) {
            return Err(format!(
                "{len} values where the shape of {:?} is {shape:?}",
                tensor.name
            ));
        }
        Ok(Self {
            shape,
            floats,
            wholes,
        })
    }
}
