"""Speed of PyTorch, ONNX Runtime and TensorFlow Lite on networks that senda exported.

    python networks.py FOLDER

FOLDER holds one folder a network, with `network.onnx` and `network.toml`. Medians over rounds. PyTorch trains with Adam and the
mean squared error on batches of 32 with two threads; inference is a batch of one on one thread. TensorFlow Lite runs what Keras'
converter makes of the same layers with fresh weights; without TensorFlow its column is empty.
"""

import pathlib
import statistics
import sys
import time
import tomllib

import numpy as np
import onnxruntime
import torch
from torch import nn

try:
    import tensorflow
except ImportError:
    tensorflow = None


def build(network):
    """Plain chains only: what PilotNet and TinyPilotNet are made of."""
    channels, layers = network["input"]["channels"], []
    shape = torch.zeros(1, channels, network["input"]["height"], network["input"]["width"])
    for layer in network["layer"]:
        match layer["kind"]:
            case "convolution":
                step = [nn.Conv2d(shape.shape[1], layer["filters"], layer["kernel"], layer["stride"])]
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
    """A TensorFlow Lite interpreter of the same chain, ready to invoke; none where it has other layers or there is no TensorFlow."""
    if tensorflow is None:
        return None
    layers = tensorflow.keras.layers
    size = network["input"]
    chain = [tensorflow.keras.Input((size["height"], size["width"], size["channels"]), batch_size=1)]
    for layer in network["layer"]:
        activation = layer.get("activation", "linear")
        match layer["kind"]:
            case "convolution":
                chain.append(layers.Conv2D(layer["filters"], layer["kernel"], layer["stride"], activation=activation))
            case "max_pool":
                chain.append(layers.MaxPooling2D(layer["size"], layer["stride"]))
            case "dropout":
                chain.append(layers.Dropout(0.2))
            case "flatten":
                chain.append(layers.Flatten())
            case "dense":
                chain.append(layers.Dense(layer["units"], activation=activation))
            case other:
                return None
    model = tensorflow.lite.TFLiteConverter.from_keras_model(tensorflow.keras.Sequential(chain)).convert()
    interpreter = tensorflow.lite.Interpreter(model_content=model, num_threads=1)
    interpreter.allocate_tensors()
    place = interpreter.get_input_details()[0]
    interpreter.set_tensor(place["index"], np.full(place["shape"], 0.25, dtype=np.float32))
    return interpreter


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
        runtime = median(lambda: session.run(None, {"input": one}), repeats) * 1e3
        interpreter = lite(network)
        light = f"{median(interpreter.invoke, repeats) * 1e3:12.4f}" if interpreter else f"{'-':>12}"
        net = build(network)
        if net is None:
            print(f"{folder.name:30}{'-':>28}{'-':>12}{runtime:17.4f}{light}")
            continue
        torch.set_num_threads(1)
        frame = torch.tensor(one)
        net.eval()
        with torch.inference_mode():
            single = median(lambda: net(frame), repeats) * 1e3
        torch.set_num_threads(2)
        net.train()
        optimiser = torch.optim.Adam(net.parameters(), 1e-3)
        inputs = torch.rand(32, *shape)
        targets = torch.full([32, net(inputs).shape[1]], 0.1)

        def step():
            optimiser.zero_grad(set_to_none=True)
            nn.functional.mse_loss(net(inputs), targets).backward()
            optimiser.step()

        step()
        rate = 32 / median(step, max(repeats // 10, 3))
        print(f"{folder.name:30}{rate:28.0f}{single:12.4f}{runtime:17.4f}{light}")


main()
