"""Speed of PyTorch, ONNX Runtime and TensorFlow Lite on networks that senda exported.

    python networks.py FOLDER

FOLDER holds one folder a network, with `network.onnx` and `network.toml`. Medians over rounds. PyTorch trains with Adam and the
mean squared error on batches of 32 with two threads; inference is a batch of one on one thread. Networks with a memory learn from 16
moments of 32 runs (truncated back-propagation, the state carried in and out); what does not depend on the state is computed for all
moments at once. TensorFlow Lite runs what Keras' converter makes of the same layers with fresh weights; without TensorFlow, and
for networks with a memory, its column is empty.
"""

import pathlib
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


def lite(network):
    """Milliseconds of TensorFlow Lite; None without TensorFlow, or with layers that it does not have: it says which."""
    script = pathlib.Path(__file__).with_name("lite.py")
    done = subprocess.run([sys.executable, script, network], capture_output=True, text=True)
    if done.returncode == 0:
        return float(done.stdout.split()[-1])
    print(f"{network}: no figure of TensorFlow Lite: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
    return None


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
