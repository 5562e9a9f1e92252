"""Compares senda's detectors with OpenCV's dnn and ONNX Runtime on darknet files that senda wrote with random weights.

    pip install 'opencv-python-headless<5' onnxruntime numpy      (OpenCV 5 reads no darknet files)
    cargo run --release -p senda_nets --example darknet -- FOLDER
    python crates/senda_nets/parity/darknet_parity.py FOLDER      (--check instead: only whether OpenCV is the right one)

Fails when a relative error (largest difference over largest value) of a head or of the decoded boxes is 1e-4 or more. Prints the
time of one answer on one thread beside senda's.
"""

import pathlib
import sys
import time

import cv2
import numpy as np
import onnxruntime

LIMIT = 1e-4


def error(own, other):
    return float(np.abs(own - other).max() / np.abs(other).max())


def best_ms(run, count=20):
    times = []
    for _ in range(count):
        begin = time.perf_counter()
        run()
        times.append((time.perf_counter() - begin) * 1e3)
    return f"{min(times):.1f} / {sorted(times)[count // 2]:.1f} ms"


def compare(folder):
    read = lambda name: np.fromfile(folder / name, dtype="<f4")
    cv2.setNumThreads(1)
    net = cv2.dnn.readNetFromDarknet(str(folder / "network.cfg"), str(folder / "network.weights"))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(folder / "network.onnx"), options, providers=["CPUExecutionProvider"])
    shape = [1, *session.get_inputs()[0].shape[1:]]
    image = read("inputs").reshape(shape)
    # The value before each [yolo] layer, and its decoded boxes.
    names = net.getLayerNames()
    yolos = [i for i, name in enumerate(names) if name.startswith("yolo")]
    net.setInput(image)
    raw = net.forward([names[i - 1] for i in yolos] + [names[i] for i in yolos])
    # Before [yolo] OpenCV moves the channels to the end.
    heads, decoded = [head.transpose(0, 3, 1, 2) for head in raw[: len(yolos)]], raw[len(yolos) :]
    outputs = read("outputs")
    errors = {
        "OpenCV, heads": error(outputs, np.concatenate([head.ravel() for head in heads])),
        "ONNX Runtime": error(outputs, session.run(None, {"input": image})[0].ravel()),
    }
    # OpenCV orders boxes cell by cell with the anchors inside, senda anchor by anchor.
    own, at = read("boxes").reshape(-1, 5), 0
    for head, boxes in zip(heads, decoded):
        cells = head.shape[2] * head.shape[3]
        boxes = boxes.reshape(cells, -1, boxes.shape[-1])
        count = cells * boxes.shape[1]
        theirs = boxes.transpose(1, 0, 2).reshape(count, -1)[:, :4]
        errors["OpenCV, boxes"] = max(errors.get("OpenCV, boxes", 0.0), error(own[at : at + count, :4], theirs))
        at += count
    for name, value in errors.items():
        print(f"{folder.name:18}{name:18}{value:10.1e}")

    def opencv():
        net.setInput(image)
        net.forward(net.getUnconnectedOutLayersNames())

    best, median = map(float, (folder / "milliseconds").read_text().split())
    print(f"{folder.name:18}best / median of 20 on one thread: senda {best:.1f} / {median:.1f} ms, "
          f"ONNX Runtime {best_ms(lambda: session.run(None, {'input': image}))}, OpenCV {best_ms(opencv)}")  # fmt: skip
    return max(errors.values()) < LIMIT


if not hasattr(cv2.dnn, "readNetFromDarknet"):
    sys.exit(f"expected OpenCV 4, which reads darknet files, but found {cv2.__version__}: pip install 'opencv-python-headless<5'")
if sys.argv[1:] == ["--check"]:
    sys.exit()
folders = sorted(folder.parent for folder in pathlib.Path(sys.argv[1]).glob("*/network.cfg"))
sys.exit(0 if folders and all([compare(folder) for folder in folders]) else 1)
