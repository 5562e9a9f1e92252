//! Nodes of a graph that become layers of ours.

use super::super::*;
use super::{Layout, Reader, Value, attribute, attribute_ints, attribute_text};
use crate::network::Shape;

impl Reader {
    /// Kernel, stride and padding as lines of a network file, and the output's size.
    fn window(
        &self,
        node: &NodeProto,
        key: &str,
        kernel: [usize; 2],
        input: Shape,
    ) -> Result<(String, [usize; 2]), String> {
        let pair = |name: &str, default: i64| -> Result<[usize; 2], String> {
            match attribute_ints(node, name).as_deref() {
                None => Ok([default as usize; 2]),
                Some([a, b]) if (1..=64).contains(a) && (1..=64).contains(b) => {
                    Ok([*a as usize, *b as usize])
                }
                Some(other) => Err(format!("{name} {other:?}")),
            }
        };
        let stride = pair("strides", 1)?;
        if pair("dilations", 1)? != [1, 1] {
            return Err("dilations".to_owned());
        }
        if attribute(node, "ceil_mode").is_some_and(|attribute| attribute.i != 0) {
            return Err("ceil_mode".to_owned());
        }
        let pads = match attribute_text(node, "auto_pad").as_str() {
            "" | "NOTSET" => match attribute_ints(node, "pads").as_deref() {
                None => [0; 4],
                Some([a, b, c, d]) if [a, b, c, d].iter().all(|pad| (0..64).contains(*pad)) => {
                    [*a as usize, *b as usize, *c as usize, *d as usize]
                }
                Some(other) => return Err(format!("pads {other:?}")),
            },
            "VALID" => [0; 4],
            "SAME_UPPER" => crate::network::Padding::Same.amounts(input, kernel, stride),
            other => return Err(format!("auto_pad {other}")),
        };
        let size = |input: usize, before: usize, after: usize, kernel: usize, stride: usize| {
            (input + before + after)
                .checked_sub(kernel)
                .map(|rest| rest / stride + 1)
        };
        let height = size(input.height, pads[0], pads[2], kernel[0], stride[0]);
        let width = size(input.width, pads[1], pads[3], kernel[1], stride[1]);
        let (Some(height), Some(width)) = (height, width) else {
            return Err("a window larger than its input".to_owned());
        };
        let text = format!("{key} = {kernel:?}\nstride = {stride:?}\npadding = {pads:?}\n");
        Ok((text, [height, width]))
    }

    pub(super) fn convolution(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.planar(node)?;
        let weight = self.floats(node, 1)?;
        let [filters, group_channels, height, width] = weight.shape[..] else {
            return Err(format!(
                "a kernel of shape {:?}, not of two dimensions",
                weight.shape
            ));
        };
        let group = attribute(node, "group").map_or(1, |attribute| attribute.i);
        let is_depthwise = group > 1;
        let channels = value.shape.channels;
        if is_depthwise && (group as usize != channels || filters != channels || group_channels != 1) {
            return Err(format!(
                "{group} groups of {channels} channels; known are 1 or one for each channel"
            ));
        }
        if !is_depthwise && group_channels != channels {
            return Err(format!("a kernel for {group_channels} channels on {channels}"));
        }
        let (window, [out_height, out_width]) = self.window(node, "kernel", [height, width], value.shape)?;
        let has_bias = node.input.get(2).is_some_and(|name| !name.is_empty());
        self.weights.push(weight.floats);
        if has_bias {
            let bias = self.floats(node, 2)?;
            self.weights.push(bias.floats);
        }
        let shape = Shape {
            channels: filters,
            height: out_height,
            width: out_width,
        };
        if is_depthwise {
            let body = format!("{window}bias = {has_bias}");
            self.layer(node, "depthwise_convolution", &body, &[&value], shape);
        } else {
            let body = format!("filters = {filters}\n{window}bias = {has_bias}");
            self.layer(node, "convolution", &body, &[&value], shape);
        }
        Ok(())
    }

    pub(super) fn pool(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.planar(node)?;
        let kernel = match attribute_ints(node, "kernel_shape").as_deref() {
            Some([a, b]) if (1..=64).contains(a) && (1..=64).contains(b) => [*a as usize, *b as usize],
            other => return Err(format!("kernel_shape {other:?}")),
        };
        let (body, [height, width]) = self.window(node, "size", kernel, value.shape)?;
        let is_average = node.op_type == "AveragePool";
        let counts_padding = attribute(node, "count_include_pad").is_some_and(|attribute| attribute.i != 0);
        if is_average && counts_padding && !body.contains("padding = [0, 0, 0, 0]") {
            return Err("count_include_pad".to_owned());
        }
        let kind = if is_average { "average_pool" } else { "max_pool" };
        let shape = Shape {
            height,
            width,
            ..value.shape
        };
        self.layer(node, kind, &body, &[&value], shape);
        Ok(())
    }

    pub(super) fn mean(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.value(node, 0)?;
        let axes = attribute_ints(node, "axes").or_else(|| self.constant(node, 1).map(|c| c.wholes.clone()));
        let mut axes: Vec<i64> = axes
            .unwrap_or_default()
            .iter()
            .map(|axis| axis.rem_euclid(4))
            .collect();
        axes.sort_unstable();
        let expected = if value.layout == Layout::Planar {
            [2, 3]
        } else {
            [1, 2]
        };
        if axes != expected {
            return Err(format!("axes {axes:?}, not height and width"));
        }
        let shape = Shape::flat(value.shape.channels);
        self.layer(node, "global_average_pool", "", &[&value], shape);
        Ok(())
    }

    pub(super) fn dense(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.value(node, 0)?;
        let weight = self.floats(node, 1)?;
        let [rows, columns] = weight.shape[..] else {
            return Err(format!("a matrix of shape {:?}", weight.shape));
        };
        let flag = |name: &str| attribute(node, name).is_some_and(|attribute| attribute.i != 0);
        let factor = |name: &str| attribute(node, name).map_or(1.0, |attribute| attribute.f);
        if flag("transA") || factor("alpha") != 1.0 || factor("beta") != 1.0 {
            return Err("transA, alpha or beta".to_owned());
        }
        let (units, inputs) = if flag("transB") {
            (rows, columns)
        } else {
            (columns, rows)
        };
        if !value.shape.is_flat() || inputs != value.shape.channels {
            return Err(format!("a matrix for {inputs} inputs on {}", value.shape));
        }
        let at = |unit: usize, input: usize| {
            if flag("transB") {
                weight.floats[unit * inputs + input]
            } else {
                weight.floats[input * units + unit]
            }
        };
        let mut own = Vec::with_capacity(units * inputs);
        for unit in 0..units {
            for input in 0..inputs {
                own.push(at(unit, interleaved_place(value.layout, input)));
            }
        }
        self.weights.push(own);
        let has_bias = node.input.get(2).is_some_and(|name| !name.is_empty());
        if has_bias {
            let bias = self.floats(node, 2)?.floats;
            if bias.len() != units {
                return Err("a bias of another length".to_owned());
            }
            self.weights.push(bias);
        }
        let body = format!("units = {units}\nbias = {has_bias}");
        let planar = Value {
            layout: Layout::Planar,
            ..value
        };
        self.layer(node, "dense", &body, &[&planar], Shape::flat(units));
        Ok(())
    }

    pub(super) fn flatten(&mut self, node: &NodeProto) -> Result<(), String> {
        let mut value = self.value(node, 0)?;
        if node.op_type == "Reshape" {
            let target = self
                .constant(node, 1)
                .map(|c| c.wholes.clone())
                .unwrap_or_default();
            let len = value.shape.len() as i64;
            let is_vector = matches!(target[..], [_, n] if n == -1 || n == len)
                || matches!(target[..], [_, n, 1, 1] if value.shape.is_flat() && (n == -1 || n == len));
            if !is_vector {
                return Err(format!("to {target:?}; known is one vector for each picture"));
            }
        } else if node.op_type == "Flatten" {
            let axis = attribute(node, "axis").map_or(1, |attribute| attribute.i);
            if axis != 1 {
                return Err(format!("axis {axis}"));
            }
        } else if value.shape.is_flat() {
            // Dimensions of size one come and go.
            self.name_output(node, value);
            return Ok(());
        } else {
            return Err("dimensions of a picture".to_owned());
        }
        if value.shape.is_flat() {
            self.name_output(node, value);
            return Ok(());
        }
        let shape = value.shape;
        value.layout = match value.layout {
            Layout::Interleaved => Layout::FlatInterleaved(shape),
            other => other,
        };
        self.layer(node, "flatten", "", &[&value], Shape::flat(shape.len()));
        Ok(())
    }

    pub(super) fn transpose(&mut self, node: &NodeProto) -> Result<(), String> {
        let mut value = self.value(node, 0)?;
        let permutation = attribute_ints(node, "perm").unwrap_or_default();
        value.layout = match (&permutation[..], value.layout) {
            ([0, 3, 1, 2], Layout::Interleaved) => Layout::Planar,
            ([0, 2, 3, 1], Layout::Planar) => Layout::Interleaved,
            _ => return Err(format!("perm {permutation:?} here")),
        };
        self.name_output(node, value);
        Ok(())
    }

    /// Sums of values, or constants on values: a bias, or scaling of the input.
    pub(super) fn arithmetic(&mut self, node: &NodeProto) -> Result<(), String> {
        let is_value = |index: usize| {
            node.input
                .get(index)
                .is_some_and(|name| self.values.contains_key(name))
        };
        if is_value(0) && is_value(1) {
            let (a, b) = (self.value(node, 0)?, self.value(node, 1)?);
            if node.op_type != "Add" || a.shape != b.shape || a.layout != b.layout {
                return Err("two values that are not a sum of equal shapes".to_owned());
            }
            self.layer(node, "add", "", &[&a, &b], a.shape);
            return Ok(());
        }
        let value_index = usize::from(!is_value(0));
        if value_index == 1 && matches!(node.op_type.as_str(), "Sub" | "Div") {
            return Err("a constant on the left".to_owned());
        }
        let value = self.value(node, value_index)?;
        let constant = self.floats(node, 1 - value_index)?;
        let channels = value.shape.channels;
        let numbers: Vec<f32> = match (constant.floats.len(), value.layout) {
            (1, _) => vec![constant.floats[0]; channels],
            (count, Layout::Planar | Layout::Interleaved) if count == channels => constant.floats,
            _ => {
                return Err(format!(
                    "a constant of shape {:?} on {}",
                    constant.shape, value.shape
                ));
            }
        };
        let apply = |number: f32| match node.op_type.as_str() {
            "Add" => (1.0, number),
            "Sub" => (1.0, -number),
            "Mul" => (number, 0.0),
            _ => (1.0 / number, 0.0),
        };
        let (factors, terms): (Vec<f32>, Vec<f32>) = numbers.into_iter().map(apply).unzip();
        // A frozen batch norm is a factor and a term for each channel.
        self.weights
            .extend([factors, terms, vec![0.0; channels], vec![1.0; channels]]);
        let body = "epsilon = 1e-9\ntrainable = false";
        self.layer(node, "batch_norm", body, &[&value], value.shape);
        Ok(())
    }

    pub(super) fn resize(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.planar(node)?;
        let mode = attribute_text(node, "mode");
        let coordinates = attribute_text(node, "coordinate_transformation_mode");
        let rounding = attribute_text(node, "nearest_mode");
        let scales = [2, 1]
            .into_iter()
            .filter_map(|index| self.constant(node, index))
            .find(|constant| constant.floats.len() == 4)
            .map(|constant| constant.floats.clone());
        let is_plain = coordinates == "asymmetric" && rounding == "floor"
            // Whole factors: these place the copies alike.
            || matches!(coordinates.as_str(), "" | "half_pixel" | "asymmetric") && mode != "linear";
        match scales.as_deref() {
            Some([1.0, 1.0, a, b]) if a == b && (1.0..=16.0).contains(a) && a.fract() == 0.0 && is_plain => {
                let factor = *a as usize;
                let shape = Shape {
                    height: value.shape.height * factor,
                    width: value.shape.width * factor,
                    ..value.shape
                };
                self.layer(node, "upsample", &format!("factor = {factor}"), &[&value], shape);
                Ok(())
            }
            other => Err(format!(
                "mode {mode:?}, scales {other:?}; known is nearest with a whole factor"
            )),
        }
    }
}

/// Where input `place` (planar) of a vector lies in the order of the file.
pub(super) fn interleaved_place(layout: Layout, place: usize) -> usize {
    match layout {
        Layout::FlatInterleaved(shape) => {
            let (channel, pixel) = (place / shape.plane(), place % shape.plane());
            pixel * shape.channels + channel
        }
        _ => place,
    }
}
