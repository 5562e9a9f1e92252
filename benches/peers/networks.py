"""Speed of PyTorch, ONNX Runtime and TensorFlow Lite on networks that senda exported.

    python networks.py FOLDER

FOLDER holds one folder a network, with `network.onnx` and `network.toml`. Medians over rounds. PyTorch trains with Adam and the
mean squared error on batches of 32 with two threads; inference is a batch of one on one thread. Networks with a memory learn from 16
moments of 32 runs (truncated back-propagation, the state carried in and out); what does not depend on the state is computed for all
moments at once. TensorFlow Lite runs what Keras' converter makes of the same layers with fresh weights; without TensorFlow, and
for networks with a memory, its column is empty.
"""

import pathlib
import statistics
import subprocess
import sys
import time
import tomllib

import numpy as np
import onnxruntime
import torch
from torch import nn

MOMENTS = 16


class ConvLSTM(nn.Module):
    """Gates input, forget, cell, output, as Keras orders them; `x` is [moments * runs, channels, height, width]."""

    def __init__(self, channels, filters, kernel, stride, padding):
        super().__init__()
        self.filters = filters
        before = kernel // 2 if padding == "same" else 0
        self.input = nn.Conv2d(channels, 4 * filters, kernel, stride, before)
        self.state = nn.Conv2d(filters, 4 * filters, kernel, padding=kernel // 2, bias=False)
        self.runs = 1
        self.carried = None

    def forward(self, x):
        gates = self.input(x)
        gates = gates.view(-1, self.runs, *gates.shape[1:])
        if self.carried is None or self.carried[0].shape[0] != self.runs:
            zero = gates.new_zeros(self.runs, self.filters, *gates.shape[3:])
            self.carried = (zero, zero)
        hidden, memory = (state.detach() for state in self.carried)
        shown = []
        for own in gates:
            i, f, c, o = torch.chunk(own + self.state(hidden), 4, dim=1)
            memory = torch.sigmoid(f) * memory + torch.sigmoid(i) * torch.tanh(c)
            hidden = torch.sigmoid(o) * torch.tanh(memory)
            shown.append(hidden)
        self.carried = (hidden, memory)
        return torch.cat(shown)


def build(network):
    """Plain chains only: what the networks of documents A and B are made of."""
    channels, layers = network["input"]["channels"], []
    shape = torch.zeros(1, channels, network["input"]["height"], network["input"]["width"])
    for layer in network["layer"]:
        match layer["kind"]:
            case "convolution":
                step = [nn.Conv2d(shape.shape[1], layer["filters"], layer["kernel"], layer["stride"])]
            case "convolutional_lstm":
                step = [ConvLSTM(shape.shape[1], layer["filters"], layer["kernel"][0], layer["stride"][0], layer["padding"])]
            case "max_pool":
                step = [nn.MaxPool2d(layer["size"], layer["stride"])]
            case "dropout":
                step = [nn.Dropout(0.2)]
            case "flatten":
                step = [nn.Flatten()]
            case "dense":
                step = [nn.Linear(shape.shape[1], layer["units"])]
            case other:
                return None
        match layer.get("activation", "linear"):
            case "relu":
                step.append(nn.ReLU())
            case "elu":
                step.append(nn.ELU())
        layers += step
        with torch.no_grad():
            shape = nn.Sequential(*step).eval()(shape)
    return nn.Sequential(*layers)


def lite(network):
    """Milliseconds of TensorFlow Lite; None without TensorFlow, or with layers that it does not have."""
    script = pathlib.Path(__file__).with_name("lite.py")
    done = subprocess.run([sys.executable, script, network], capture_output=True, text=True)
    return float(done.stdout.split()[-1]) if done.returncode == 0 else None


def median(work, repeats, rounds=9):
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(repeats):
            work()
        times.append((time.perf_counter() - start) / repeats)
    return statistics.median(times)


def main():
    print(f"{'network':30}{'PyTorch train/s, 2 threads':>28}{'PyTorch ms':>12}{'ONNX Runtime ms':>17}{'TF Lite ms':>12}")
    for folder in sorted(pathlib.Path(sys.argv[1]).iterdir()):
        network = tomllib.loads((folder / "network.toml").read_text())
        shape = [network["input"][key] for key in ("channels", "height", "width")]
        repeats = 20 if shape[1] * shape[2] > 4096 else 500
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        session = onnxruntime.InferenceSession(
            str(folder / "network.onnx"), options, providers=["CPUExecutionProvider"]
        )
        one = np.full([1, *shape], 0.25, dtype=np.float32)
        # A memory goes in and comes out by inputs of its own.
        given = {i.name: np.zeros([1, *i.shape[1:]], dtype=np.float32) for i in session.get_inputs()}
        given["input"] = one
        runtime = median(lambda: session.run(None, given), repeats) * 1e3
        light_ms = lite(folder / "network.toml")
        light = f"{'-':>12}" if light_ms is None else f"{light_ms:12.4f}"
        net = build(network)
        if net is None:
            print(f"{folder.name:30}{'-':>28}{'-':>12}{runtime:17.4f}{light}")
            continue
        recurrent = [module for module in net.modules() if isinstance(module, ConvLSTM)]
        moments = MOMENTS if recurrent else 1
        torch.set_num_threads(1)
        frame = torch.tensor(one)
        net.eval()
        with torch.inference_mode():
            single = median(lambda: net(frame), repeats) * 1e3
        torch.set_num_threads(2)
        net.train()
        optimiser = torch.optim.Adam(net.parameters(), 1e-3)
        inputs = torch.rand(moments * 32, *shape)
        for module in recurrent:
            module.runs = 32
        targets = torch.full([moments * 32, net(inputs).shape[1]], 0.1)

        def step():
            optimiser.zero_grad(set_to_none=True)
            nn.functional.mse_loss(net(inputs), targets).backward()
            optimiser.step()

        step()
        rate = moments * 32 / median(step, max(repeats // 10 // moments, 3))
        print(f"{folder.name:30}{rate:28.0f}{single:12.4f}{runtime:17.4f}{light}")


main()
