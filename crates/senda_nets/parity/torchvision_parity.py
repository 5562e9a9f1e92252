"""Compares the MobileNetV2 of networks/mobilenetv2-head.toml with torchvision's, weights taken from files.

    pip install torch torchvision safetensors onnx numpy
    python crates/senda_nets/parity/torchvision_parity.py --write FOLDER
    cargo run --release -p senda_nets --example parity -- FOLDER/a mobilenetv2-head=FOLDER/mobilenetv2.safetensors
    cargo run --release -p senda_nets --example parity -- FOLDER/b mobilenetv2-head=FOLDER/mobilenetv2.onnx
    python crates/senda_nets/parity/torchvision_parity.py FOLDER

The weights are random, with statistics as if trained. Fails at a relative error of 1e-4 or more.
"""

import pathlib
import sys

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torchvision.models import mobilenet_v2

LIMIT = 1e-4
folder = pathlib.Path(sys.argv[-1])
net = mobilenet_v2(weights=None).eval()
if "--write" in sys.argv:
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(1)
    for module in net.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.uniform_(-0.2, 0.2)
            module.running_var.uniform_(0.5, 1.5)
            torch.nn.init.uniform_(module.bias, -0.1, 0.1)
    save_file(net.state_dict(), folder / "mobilenetv2.safetensors")
    torch.onnx.export(net, torch.zeros(1, 3, 224, 224), folder / "mobilenetv2.onnx", dynamo=False)
    sys.exit()

net.load_state_dict(load_file(folder / "mobilenetv2.safetensors"))
worst = 0.0
for which in ["a", "b"]:
    result = folder / which / "mobilenetv2-head"
    read = lambda name: np.fromfile(result / name, dtype="<f4")
    head = torch.tensor(read("weights")[-368_705:])
    kernel, bias, dense, last = head.split([368_640, 32, 32, 1])
    with torch.no_grad():
        x = net.features(torch.tensor(read("inputs").reshape(-1, 3, 224, 224)))
        x = torch.relu(torch.nn.functional.conv2d(x, kernel.reshape(32, 1280, 3, 3), bias)).mean((2, 3))
        other = (x @ dense + last).numpy()
    error = np.abs(read("outputs") - other).max() / np.abs(other).max()
    print(f"{which}: {error:.1e}")
    worst = max(worst, error)
print(f"largest relative error {worst:.1e}, limit {LIMIT:.0e}")
sys.exit(worst >= LIMIT)
