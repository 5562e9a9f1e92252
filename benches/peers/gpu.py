"""Whether networks that senda exported run on an accelerator whole, what they answer there, and how fast (A14).

    python gpu.py FOLDER [cuda|cpu]

FOLDER holds ONNX files (`senda model export`); needs torch, onnx, onnxruntime and numpy. Every node of a graph runs as one of PyTorch's
operations on the device: there is no way back to the processor, an operation that has none is named. The answers are compared
with ONNX Runtime's on the processor; speed is that of a recorded CUDA graph, copies of frames not counted. Beside it PyTorch trains PilotNet
and TinyPilotNet on the device, from the layer lists in `networks/`.
"""

import pathlib
import sys
import time
import tomllib

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import numpy_helper
from torch import nn
from torch.nn import functional

from torch_networks import build

BATCHES = [1, 256]
NETWORKS = pathlib.Path(__file__).resolve().parents[2] / "networks"


def padded(x, attributes, value=0.0):
    """ONNX's padding: all beginnings, then all ends."""
    top, left, bottom, right = attributes.get("pads", [0, 0, 0, 0])
    return functional.pad(x, (left, right, top, bottom), value=value) if top + left + bottom + right else x


def rounded(x, scale, zero):
    kind = torch.iinfo(zero.dtype)
    return torch.clamp(torch.round(x / scale) + zero, kind.min, kind.max).to(zero.dtype)


def along(values, x, axis):
    """Values for each channel as they meet `x`."""
    return values.view([-1 if dimension == axis else 1 for dimension in range(x.dim())]) if values.dim() == 1 else values


OPERATIONS = {
    "Conv": lambda a, x, w, b=None: functional.conv2d(padded(x, a), w, b, a.get("strides", 1), groups=a.get("group", 1)),
    "Gemm": lambda a, x, w, b: functional.linear(x, w if a.get("transB") else w.T, b),
    "BatchNormalization": lambda a, x, w, b, m, v: functional.batch_norm(x, m, v, w, b, eps=a.get("epsilon", 1e-5)),
    "Relu": lambda a, x: torch.relu(x),
    "LeakyRelu": lambda a, x: functional.leaky_relu(x, a.get("alpha", 0.01)),
    "Elu": lambda a, x: functional.elu(x, a.get("alpha", 1.0)),
    "Clip": lambda a, x, low, high: torch.clamp(x, low, high),
    "Sigmoid": lambda a, x: torch.sigmoid(x),
    "Tanh": lambda a, x: torch.tanh(x),
    "Add": lambda a, x, y: x + y,
    "Mul": lambda a, x, y: x * y,
    "Split": lambda a, x, sizes=None: torch.split(x, sizes.tolist() if sizes is not None else x.shape[a["axis"]] // 4, a["axis"]),
    "MaxPool": lambda a, x: functional.max_pool2d(padded(x, a, float("-inf")), a["kernel_shape"], a.get("strides", 1)),
    "GlobalAveragePool": lambda a, x: x.mean((2, 3), keepdim=True),
    "Flatten": lambda a, x: torch.flatten(x, a.get("axis", 1)),
    "Identity": lambda a, x: x,
    "QuantizeLinear": lambda a, x, s, z: rounded(x, along(s, x, a.get("axis", 1)), along(z, x, a.get("axis", 1))),
    "DequantizeLinear": lambda a, x, s, z: (x.float() - along(z, x, a.get("axis", 1)).float()) * along(s, x, a.get("axis", 1)),
}


class Graph:
    """A graph as a list of the device's operations."""

    def __init__(self, path, device):
        graph = onnx.load(path).graph
        self.inputs = [(i.name, [d.dim_value for d in i.type.tensor_type.shape.dim][1:]) for i in graph.input]
        self.outputs = [o.name for o in graph.output]
        host = {"Split": [1]}  # shapes, which no operation computes with
        kept = {n.input[k] for n in graph.node for k in host.get(n.op_type, []) if k < len(n.input)}
        self.values = {}
        for i in graph.initializer:
            value = torch.tensor(numpy_helper.to_array(i).copy())
            self.values[i.name] = value if i.name in kept else value.to(device)
        self.nodes = []
        for node in graph.node:
            if node.op_type not in OPERATIONS:
                sys.exit(f"{path}: no operation of the device for {node.op_type}")
            attributes = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
            self.nodes.append((OPERATIONS[node.op_type], attributes, list(node.input), list(node.output)))

    def __call__(self, given):
        values = {**self.values, **given, "": None}
        for operation, attributes, inputs, outputs in self.nodes:
            result = operation(attributes, *[values[name] for name in inputs])
            values.update(zip(outputs, result if isinstance(result, tuple) else (result,)))
        return [values[name] for name in self.outputs]


def recorded(work, device):
    """The same work without the processor between its steps."""
    if device == "cpu":
        return work
    stream = torch.cuda.Stream()
    with torch.cuda.stream(stream):
        for _ in range(3):
            work()
    torch.cuda.synchronize()
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        work()
    return graph.replay


def seconds(work, device):
    """Of one repeat: median of five rounds."""
    wait = torch.cuda.synchronize if device != "cpu" else lambda: None
    work()
    wait()
    rounds = []
    for _ in range(5):
        began, count = time.perf_counter(), 0
        while time.perf_counter() - began < 0.2:
            for _ in range(1 if device == "cpu" else 20):
                work()
                count += 1
            wait()
        rounds.append((time.perf_counter() - began) / count)
    return sorted(rounds)[2]


def infer(path, device):
    graph = Graph(path, device)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    random = np.random.default_rng(1)
    told = []
    for batch in BATCHES:
        given = {name: random.uniform(-1, 1, [batch, *shape]).astype(np.float32) for name, shape in graph.inputs}
        expected = session.run(None, given)
        there = {name: torch.tensor(value).to(device) for name, value in given.items()}
        with torch.inference_mode():
            found = [value.cpu().numpy() for value in graph(there)]
            apart = max(np.abs(f - e).max() / max(np.abs(e).max(), 1e-9) for f, e in zip(found, expected))
            time_s = seconds(recorded(lambda: graph(there), device), device)
        told.append(f"{time_s * 1e3:9.4f} ms a batch of {batch:3} ({batch / time_s:10.0f}/s), apart {apart:.1e}")
    print(f"{path.stem:28}{len(graph.nodes):4} nodes, all on {device}: " + "; ".join(told))


def train(name, batch, device):
    network = tomllib.loads((NETWORKS / f"{name}.toml").read_text())
    net = build(network).to(device).train()
    shape = [network["input"][key] for key in ("channels", "height", "width")]
    inputs = torch.rand(batch, *shape, device=device)
    with torch.no_grad():
        targets = torch.full_like(net(inputs), 0.1)
    optimiser = torch.optim.Adam(net.parameters(), 1e-3, capturable=device != "cpu")

    def step():
        optimiser.zero_grad(set_to_none=True)
        nn.functional.mse_loss(net(inputs), targets).backward()
        optimiser.step()

    step()
    rates = [batch / seconds(step, device)]
    if device != "cpu":
        rates.append(batch / seconds(recorded(step, device), device))
    print(f"{name:28} PyTorch learns on {device}, batch {batch:3}: " + ", as a CUDA graph ".join(f"{rate:.0f} images/s" for rate in rates))


def main():
    device = sys.argv[2] if len(sys.argv) > 2 else "cuda"
    # The processor's arithmetic: no shorter mantissas.
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.backends.cudnn.allow_tf32 = False
    print(torch.__version__, torch.cuda.get_device_name() if device != "cpu" else "processor")
    for path in sorted(pathlib.Path(sys.argv[1]).glob("*.onnx")):
        infer(path, device)
    for name in ["pilotnet", "tinypilotnet"]:
        for batch in [32, 512]:
            train(name, batch, device)


main()
