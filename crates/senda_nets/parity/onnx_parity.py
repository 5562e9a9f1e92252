"""Compares senda's engine with ONNX Runtime, on what senda exports and on what other frameworks export.

    pip install onnxruntime numpy torch onnx
    python crates/senda_nets/parity/onnx_parity.py --write FOLDER/others      # PyTorch's exports
    cargo run --release -p senda_nets --example parity -- FOLDER/results NETWORKS... FOLDER/others/*.onnx
    python crates/senda_nets/parity/onnx_parity.py FOLDER/results

Fails when a relative error (largest difference over largest value) is 1e-5 or more.
"""

import pathlib
import sys

import numpy as np

LIMIT = 1e-5


def write(folder):
    import torch
    from torch import nn

    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(1)
    conv = lambda i, o, k, s=1: [nn.Conv2d(i, o, k, s), nn.ELU()]
    pilotnet = nn.Sequential(
        *conv(3, 24, 5, 2), *conv(24, 36, 5, 2), *conv(36, 48, 5, 2), *conv(48, 64, 3), *conv(64, 64, 3),
        nn.Flatten(), nn.Linear(1152, 100), nn.ELU(), nn.Linear(100, 50), nn.ELU(), nn.Linear(50, 10), nn.ELU(),
        nn.Linear(10, 1),
    )  # fmt: skip

    class Inverted(nn.Module):
        """MobileNetV2's block."""

        def __init__(self, i, o, stride, factor):
            super().__init__()
            norm = lambda c: nn.BatchNorm2d(c)
            self.adds = stride == 1 and i == o
            h = i * factor
            self.body = nn.Sequential(
                nn.Conv2d(i, h, 1, bias=False), norm(h), nn.ReLU6(),
                nn.Conv2d(h, h, 3, stride, 1, groups=h, bias=False), norm(h), nn.ReLU6(),
                nn.Conv2d(h, o, 1, bias=False), norm(o),
            )  # fmt: skip

        def forward(self, x):
            return x + self.body(x) if self.adds else self.body(x)

    mobile = nn.Sequential(
        nn.Conv2d(3, 8, 3, 2, 1, bias=False), nn.BatchNorm2d(8), nn.ReLU6(), Inverted(8, 8, 1, 6), Inverted(8, 12, 2, 6),
        nn.AvgPool2d(2), nn.Upsample(scale_factor=2), nn.LeakyReLU(0.1), nn.MaxPool2d(3, 2, 1), nn.Dropout(0.2),
        nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(12, 2), nn.Tanh(),
    )  # fmt: skip
    for module in mobile.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.running_mean.uniform_(-0.2, 0.2)
            module.running_var.uniform_(0.5, 1.5)
    for name, net, shape in [("torch-pilotnet", pilotnet, (3, 66, 200)), ("torch-mobile", mobile, (3, 64, 96))]:
        torch.onnx.export(net.eval(), torch.zeros(1, *shape), folder / f"{name}.onnx", dynamo=False,
                          input_names=["input"], dynamic_axes={"input": {0: "batch"}})  # fmt: skip


def compare(folder):
    import onnxruntime

    read = lambda name: np.fromfile(folder / name, dtype="<f4")
    steps, batch, _ = (folder / "shape.txt").read_text().split()
    steps, batch = int(steps), int(batch)
    session = onnxruntime.InferenceSession(str(folder / "network.onnx"), providers=["CPUExecutionProvider"])
    first, *states = session.get_inputs()
    state = {s.name: np.zeros([batch, *s.shape[1:]], dtype=np.float32) for s in states}
    outputs = []
    names = [output.name for output in session.get_outputs()]
    for frames in read("inputs").reshape(steps, batch, *first.shape[1:]):
        result = dict(zip(names, session.run(None, {first.name: frames} | state)))
        outputs.append(result[names[0]])
        state = {name: result[name.replace("_in", "_out")] for name in state}
    own, other = read("outputs"), np.stack(outputs).ravel()
    error = float(np.abs(own - other).max() / np.abs(other).max())
    print(f"{folder.name:28}{error:12.1e}")
    return error


folder = pathlib.Path(sys.argv[-1])
if "--write" in sys.argv:
    write(folder)
else:
    worst = max(compare(each) for each in sorted(folder.iterdir()))
    print(f"largest relative error {worst:.1e}, limit {LIMIT:.0e}")
    sys.exit(worst >= LIMIT)
