"""Speed of TensorFlow Lite on a network of convolutions and dense layers, one image on one thread: milliseconds, median over rounds.

    python lite.py network.toml

Its own program: TensorFlow and PyTorch do not live in one process. Needs tensorflow and numpy.
"""

import sys
import tomllib

import numpy as np
import tensorflow

from timing import median


def converted(network):
    """What Keras' converter makes of the layers, with fresh weights; None where it has no such layer."""
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


def main():
    with open(sys.argv[1], "rb") as file:
        interpreter = converted(tomllib.load(file))
    if interpreter is None:
        sys.exit("a layer that Keras does not have")
    print(median(interpreter.invoke, repeats=200) * 1e3)


main()
