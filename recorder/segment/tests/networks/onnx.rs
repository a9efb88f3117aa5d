//! ONNX files by hand: a model whose outputs are constants, plus zero times the input so that the input counts.

fn varint(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn number(field: u64, value: u64, out: &mut Vec<u8>) {
    varint(field << 3, out);
    varint(value, out);
}

fn bytes(field: u64, value: &[u8], out: &mut Vec<u8>) {
    varint(field << 3 | 2, out);
    varint(value.len() as u64, out);
    out.extend(value);
}

fn tensor(name: &str, shape: &[usize], data: &[f32]) -> Vec<u8> {
    let mut out = Vec::new();
    shape.iter().for_each(|extent| number(1, *extent as u64, &mut out));
    number(2, 1, &mut out); // FLOAT
    bytes(8, name.as_bytes(), &mut out);
    let raw: Vec<u8> = data.iter().flat_map(|value| value.to_le_bytes()).collect();
    bytes(9, &raw, &mut out);
    out
}

/// `ValueInfoProto` of a float tensor.
fn value_info(name: &str, shape: &[usize]) -> Vec<u8> {
    let mut dimensions = Vec::new();
    for extent in shape {
        let mut dimension = Vec::new();
        number(1, *extent as u64, &mut dimension);
        bytes(1, &dimension, &mut dimensions);
    }
    let (mut tensor, mut kind, mut out) = (Vec::new(), Vec::new(), Vec::new());
    number(1, 1, &mut tensor); // FLOAT
    bytes(2, &dimensions, &mut tensor);
    bytes(1, &tensor, &mut kind);
    bytes(1, name.as_bytes(), &mut out);
    bytes(2, &kind, &mut out);
    out
}

fn node(operator: &str, inputs: &[&str], output: &str) -> Vec<u8> {
    let mut out = Vec::new();
    inputs.iter().for_each(|name| bytes(1, name.as_bytes(), &mut out));
    bytes(2, output.as_bytes(), &mut out);
    bytes(4, operator.as_bytes(), &mut out);
    out
}

/// An output: name, shape, values.
pub type Output<'a> = (&'a str, &'a [usize], &'a [f32]);

/// A model with input `x` [1, 3, height, width]. Output k is its values plus 0 * x[0, 0, 0, 0].
pub fn model(height: usize, width: usize, outputs: &[Output<'_>]) -> Vec<u8> {
    let mut graph = Vec::new();
    // Mean over everything is one number, and zero times it is zero.
    bytes(1, &node("GlobalAveragePool", &["x"], "mean"), &mut graph);
    bytes(1, &node("ReduceSum", &["mean"], "sum"), &mut graph);
    bytes(1, &node("Mul", &["sum", "zero"], "nothing"), &mut graph);
    bytes(1, &node("Reshape", &["nothing", "scalar"], "nought"), &mut graph);
    for (name, ..) in outputs {
        bytes(1, &node("Add", &[&format!("{name}_values"), "nought"], name), &mut graph);
    }
    bytes(2, b"by hand", &mut graph);
    bytes(5, &tensor("zero", &[1], &[0.0]), &mut graph);
    let mut shape = Vec::new();
    number(1, 1, &mut shape);
    number(2, 7, &mut shape); // INT64
    bytes(8, b"scalar", &mut shape);
    bytes(9, &1_i64.to_le_bytes(), &mut shape);
    bytes(5, &shape, &mut graph);
    for (name, shape, values) in outputs {
        bytes(5, &tensor(&format!("{name}_values"), shape, values), &mut graph);
    }
    bytes(11, &value_info("x", &[1, 3, height, width]), &mut graph);
    outputs.iter().for_each(|(name, shape, _)| bytes(12, &value_info(name, shape), &mut graph));
    let (mut opset, mut out) = (Vec::new(), Vec::new());
    number(2, 17, &mut opset);
    number(1, 8, &mut out); // IR version
    bytes(7, &graph, &mut out);
    bytes(8, &opset, &mut out);
    out
}
