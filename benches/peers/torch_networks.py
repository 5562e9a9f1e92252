"""Networks of senda as PyTorch modules, with PyTorch's first weights."""

import torch
from torch import nn


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
                step = [nn.Conv2d(shape.shape[1], layer["filters"], layer["kernel"], layer.get("stride", 1))]
            case "convolutional_lstm":
                step = [ConvLSTM(shape.shape[1], layer["filters"], layer["kernel"][0], layer["stride"][0], layer["padding"])]
            case "max_pool":
                step = [nn.MaxPool2d(layer["size"], layer.get("stride", layer["size"]))]
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
