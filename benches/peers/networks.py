"""Speed of senda, PyTorch, ONNX Runtime and TensorFlow Lite on the same networks, in turns.

    python networks.py FOLDER SPEED [TURNS]

FOLDER holds one folder a network, with `network.onnx` and `network.toml`; SPEED is senda's example `speed`. In every turn each of
them measures for some seconds, one after the other, since machines change their speed from minute to minute; a ratio is that of one turn, and what is
printed are medians over turns with the lowest and the highest. PyTorch and senda train with Adam and the mean squared
error on batches of 32 with two threads; inference is a batch of one on one thread. Networks with a memory learn from 16
moments of 32 runs (truncated back-propagation, the state carried in and out); what does not depend on the state is computed for all
moments at once. TensorFlow Lite runs what Keras' converter makes of the same layers with fresh weights; without TensorFlow, and
for networks with a memory, it has no figure.
"""

import pathlib
import statistics
import subprocess
import sys
import tomllib

import numpy as np
import onnxruntime
import torch
from torch import nn

from timing import median
from torch_networks import ConvLSTM, build

MOMENTS = 16


def senda(speed, name):
    """Milliseconds a frame, images a second in training with two threads."""
    done = subprocess.run([speed, name], capture_output=True, text=True, check=True)
    _, milliseconds, _, rate = done.stdout.splitlines()[-1].split()
    return float(milliseconds), float(rate)


def lite(network):
    """Milliseconds of TensorFlow Lite; None without TensorFlow, or with layers that it does not have: it says which."""
    script = pathlib.Path(__file__).with_name("lite.py")
    done = subprocess.run([sys.executable, script, network], capture_output=True, text=True)
    if done.returncode == 0:
        return float(done.stdout.split()[-1])
    print(f"{network}: no figure of TensorFlow Lite: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
    return None


class Peers:
    """PyTorch and ONNX Runtime on one network."""

    def __init__(self, folder):
        network = tomllib.loads((folder / "network.toml").read_text())
        shape = [network["input"][key] for key in ("channels", "height", "width")]
        self.repeats = 20 if shape[1] * shape[2] > 4096 else 500
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(
            str(folder / "network.onnx"), options, providers=["CPUExecutionProvider"]
        )
        one = np.full([1, *shape], 0.25, dtype=np.float32)
        # A memory goes in and comes out by inputs of its own.
        self.given = {i.name: np.zeros([1, *i.shape[1:]], dtype=np.float32) for i in self.session.get_inputs()}
        self.given["input"] = one
        self.frame = torch.tensor(one)
        self.net = build(network)
        if self.net is None:
            return
        self.recurrent = [module for module in self.net.modules() if isinstance(module, ConvLSTM)]
        self.moments = MOMENTS if self.recurrent else 1
        self.optimiser = torch.optim.Adam(self.net.parameters(), 1e-3)
        self.inputs = torch.rand(self.moments * 32, *shape)
        self.runs(32)
        self.targets = torch.full([self.moments * 32, self.net(self.inputs).shape[1]], 0.1)

    def runs(self, count):
        for module in self.recurrent:
            module.runs = count

    def runtime_ms(self):
        return median(lambda: self.session.run(None, self.given), self.repeats) * 1e3

    def torch_ms(self):
        torch.set_num_threads(1)
        self.net.eval()
        self.runs(1)
        with torch.inference_mode():
            return median(lambda: self.net(self.frame), self.repeats) * 1e3

    def torch_rate(self):
        torch.set_num_threads(2)
        self.net.train()
        self.runs(32)

        def step():
            self.optimiser.zero_grad(set_to_none=True)
            nn.functional.mse_loss(self.net(self.inputs), self.targets).backward()
            self.optimiser.step()

        step()
        return self.moments * 32 / median(step, max(self.repeats // 10 // self.moments, 3))


def told(name, unit, turns, ours, more_is_better):
    """One line: both medians, and by how much senda is faster in the same turn."""
    turns = [(mine, other) for mine, other in zip(ours, turns) if other is not None]
    if not turns:
        return
    ratios = sorted(mine / other if more_is_better else other / mine for mine, other in turns)
    other = statistics.median(other for _, other in turns)
    mine = statistics.median(ours)
    print(f"  {name:34}{mine:12.6g}{other:12.6g} {unit:4}{statistics.median(ratios):8.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})")


def main():
    turns = int(sys.argv[3]) if len(sys.argv) > 3 else 3
    print(f"{'':36}{'senda':>12}{'other':>12}      times as fast (lowest to highest of {turns} turns)")
    for folder in sorted(pathlib.Path(sys.argv[1]).iterdir()):
        peers = Peers(folder)
        seen = []
        for _ in range(turns):
            milliseconds, rate = senda(sys.argv[2], folder.name)
            known = peers.net is not None
            seen.append(
                {
                    "rate": rate,
                    "ms": milliseconds,
                    "torch rate": peers.torch_rate() if known else None,
                    "torch": peers.torch_ms() if known else None,
                    "runtime": peers.runtime_ms(),
                    "lite": lite(folder / "network.toml"),
                }
            )
        print(folder.name)
        of = lambda key: [turn[key] for turn in seen]
        told("training, PyTorch, 2 threads", "1/s", of("torch rate"), of("rate"), True)
        told("one image, ONNX Runtime", "ms", of("runtime"), of("ms"), False)
        told("one image, TensorFlow Lite", "ms", of("lite"), of("ms"), False)
        told("one image, PyTorch", "ms", of("torch"), of("ms"), False)


main()
