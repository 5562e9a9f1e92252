"""Compares senda's engine with PyTorch: outputs and gradients of every layer kind and of whole networks.

    pip install torch numpy
    cargo run --release -p senda_nets --example parity -- FOLDER crates/senda_nets/tests/networks/*.toml pilotnet ...
    python crates/senda_nets/parity/parity.py FOLDER

Fails when a relative error (largest difference over largest value) of an output or of the gradient of a tensor is
1e-4 or more.
"""

import pathlib
import sys
import tomllib

import numpy as np
import torch
import torch.nn.functional as F

LIMIT = 1e-4


def amounts(padding, size, kernel, stride):
    if padding == "valid":
        return [0, 0, 0, 0]
    if isinstance(padding, list):
        return padding
    total = [max((-(-size[i] // stride[i]) - 1) * stride[i] + kernel[i] - size[i], 0) for i in (0, 1)]
    return [total[0] // 2, total[1] // 2, total[0] - total[0] // 2, total[1] - total[1] // 2]


def pad(x, layer, window, value=0.0):
    top, left, bottom, right = amounts(layer["padding"], x.shape[2:], layer[window], layer["stride"])
    return F.pad(x, (left, right, top, bottom), value=value)


def activate(x, layer):
    match layer.get("activation", "linear"):
        case "linear":
            return x
        case "relu":
            return F.relu(x)
        case "leaky_relu":
            return F.leaky_relu(x, layer["slope"])
        case "relu6":
            return F.relu6(x)
        case "elu":
            return F.elu(x)
        case "sigmoid":
            return torch.sigmoid(x)
        case "tanh":
            return torch.tanh(x)


class Reference:
    def __init__(self, network, values):
        self.network = network
        self.values = values
        self.at = 0
        self.tensors = {}
        self.state = {}

    def tensor(self, name, shape, is_trainable):
        if name not in self.tensors:
            count = int(np.prod(shape))
            block = self.values[self.at : self.at + count].reshape(shape)
            self.at += count
            self.tensors[name] = torch.tensor(block, requires_grad=is_trainable)
        return self.tensors[name]

    def forward(self, x, is_training):
        nodes = {"input": x}
        for layer in self.network["layer"]:
            name = layer["name"]
            sources = layer.get("from", [])
            sources = [sources] if isinstance(sources, str) else sources
            inputs = [nodes[s] for s in sources] or [x]
            x = nodes[name] = activate(self.layer(layer, name, inputs, is_training), layer)
        return x

    def layer(self, layer, name, inputs, is_training):
        x = inputs[0]
        moves = layer.get("trainable", True)
        tensor = lambda suffix, shape, m=True: self.tensor(f"{name}.{suffix}", shape, moves and m)
        match layer["kind"]:
            case "convolution":
                weight = tensor("weight", [layer["filters"], x.shape[1], *layer["kernel"]])
                bias = tensor("bias", [layer["filters"]]) if layer["bias"] else None
                return F.conv2d(pad(x, layer, "kernel"), weight, bias, layer["stride"])
            case "depthwise_convolution":
                weight = tensor("weight", [x.shape[1], 1, *layer["kernel"]])
                bias = tensor("bias", [x.shape[1]]) if layer["bias"] else None
                return F.conv2d(pad(x, layer, "kernel"), weight, bias, layer["stride"], groups=x.shape[1])
            case "dense":
                x = x.flatten(1)
                weight = tensor("weight", [layer["units"], x.shape[1]])
                return F.linear(x, weight, tensor("bias", [layer["units"]]) if layer["bias"] else None)
            case "max_pool":
                return F.max_pool2d(pad(x, layer, "size", -torch.inf), layer["size"], layer["stride"])
            case "average_pool":
                total = F.avg_pool2d(pad(x, layer, "size"), layer["size"], layer["stride"])
                return total / F.avg_pool2d(pad(torch.ones_like(x), layer, "size"), layer["size"], layer["stride"])
            case "global_average_pool":
                return x.mean((2, 3), keepdim=True)
            case "flatten":
                return x.flatten(1)[:, :, None, None]
            case "activation" | "dropout":
                return x
            case "batch_norm":
                c = [x.shape[1]]
                weight, bias = tensor("weight", c), tensor("bias", c)
                mean, var = tensor("running_mean", c, False), tensor("running_var", c, False)
                uses_batch = is_training and moves
                x = x[:, :, None, None] if x.dim() == 2 else x
                return F.batch_norm(x, mean.clone(), var.clone(), weight, bias, uses_batch, 0.1, layer["epsilon"])
            case "upsample":
                return F.interpolate(x, scale_factor=layer["factor"], mode="nearest")
            case "concatenate":
                return torch.cat(inputs, 1)
            case "add":
                return sum(inputs)
            case "convolutional_lstm":
                f = layer["filters"]
                weight = tensor("weight", [4 * f, x.shape[1], *layer["kernel"]])
                recurrent = tensor("recurrent_weight", [4 * f, f, *layer["kernel"]])
                gates = F.conv2d(pad(x, layer, "kernel"), weight, tensor("bias", [4 * f]), layer["stride"])
                h, c = self.state.get(name) or (torch.zeros_like(gates[:, :f]),) * 2
                gates = gates + F.conv2d(
                    pad(h, {"padding": "same", "kernel": layer["kernel"], "stride": [1, 1]}, "kernel"), recurrent
                )
                i, forget, g, o = gates.chunk(4, 1)
                c = torch.sigmoid(forget) * c + torch.sigmoid(i) * torch.tanh(g)
                h = torch.sigmoid(o) * torch.tanh(c)
                self.state[name] = (h, c)
                return h
        raise SystemExit(f"unknown layer {layer['kind']}")


def error(own, other):
    own, other = np.asarray(own).ravel(), np.asarray(other).ravel()
    return float(np.abs(own - other).max() / max(np.abs(other).max(), 1e-30))


def compare(folder):
    read = lambda name: np.fromfile(folder / name, dtype="<f4")
    network = tomllib.loads((folder / "network.toml").read_text())
    steps, batch, loss = (folder / "shape.txt").read_text().split()
    steps, batch, loss = int(steps), int(batch), float(loss)
    shape = network["input"]
    x = torch.tensor(read("inputs").reshape(steps, batch, shape["channels"], shape["height"], shape["width"]))
    reference = Reference(network, read("weights"))
    with torch.no_grad():
        outputs = [reference.forward(frames, False).flatten(1) for frames in x]
    output_error = error(read("outputs"), torch.stack(outputs))
    assert reference.at == len(reference.values), "weights are left over"
    reference.state = {}
    outputs = torch.stack([reference.forward(frames, True).flatten(1) for frames in x])
    targets = torch.tensor(read("targets").reshape(outputs.shape))
    reference_loss = F.mse_loss(outputs, targets)
    reference_loss.backward()
    gradient, at, worst = read("gradient"), 0, (0.0, "")
    for name, tensor in reference.tensors.items():
        if tensor.requires_grad:
            own = gradient[at : at + tensor.numel()]
            at += tensor.numel()
            # A bias in front of a batch norm has no gradient but rounding: compare with the whole gradient then.
            size = max(float(tensor.grad.abs().max()), 1e-4 * float(np.abs(gradient).max()))
            worst = max(worst, (float(np.abs(own - tensor.grad.numpy().ravel()).max()) / size, name))
    assert at == len(gradient)
    loss_error = abs(loss - reference_loss.item()) / reference_loss.item()
    print(f"{folder.name:28}{output_error:12.1e}{loss_error:12.1e}{worst[0]:12.1e}  {worst[1]}")
    return max(output_error, loss_error, worst[0])


torch.set_num_threads(2)
print(f"{'network':28}{'outputs':>12}{'loss':>12}{'gradients':>12}  worst tensor   (PyTorch {torch.__version__})")
worst = max(compare(folder) for folder in sorted(pathlib.Path(sys.argv[1]).iterdir()))
print(f"largest relative error {worst:.1e}, limit {LIMIT:.0e}")
sys.exit(worst >= LIMIT)
