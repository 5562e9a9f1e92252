"""PyTorch's PilotNet on the frames of a Donkeycar tub, as `senda train TUB --plan scenarios/train-tub.toml` has it: the lower two thirds
of every frame at 200x66, as it is and mirrored, 8 epochs of Adam; the last fifth of the drive judges.

    python tub.py TUB [SEEDS]

Prints, for each seed, the mean absolute error (of full lock) and the correlation at the epoch with the least squared error, and at the
last one. Needs torch, numpy and Pillow.
"""

import json
import pathlib
import sys
import tomllib

import numpy as np
import torch
from PIL import Image

from torch_networks import build

PILOTNET = pathlib.Path(__file__).parents[2] / "networks" / "pilotnet.toml"
EPOCHS = 8
BATCH = 32


def read(tub):
    """Frames [count, 3, 66, 200] from -1 to 1, and the human's steering."""
    records = []
    for catalog in sorted(tub.glob("[!.]*.catalog")):
        records += [json.loads(line) for line in catalog.read_text().splitlines() if line.strip()]
    records.sort(key=lambda record: record["_index"])
    frames = []
    for record in records:
        image = Image.open(tub / "images" / record["cam/image_array"]).convert("RGB")
        width, height = image.size
        image = image.crop((0, height // 3, width, height)).resize((200, 66), Image.Resampling.BILINEAR)
        frames.append(np.asarray(image, dtype=np.float32) / 127.5 - 1)
    frames = torch.from_numpy(np.stack(frames)).permute(0, 3, 1, 2).contiguous()
    return frames, torch.tensor([record["user/angle"] for record in records], dtype=torch.float32)


def main():
    frames, steering = read(pathlib.Path(sys.argv[1]))
    pilotnet = tomllib.loads(PILOTNET.read_text())
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    learned = len(frames) * 4 // 5
    shown = torch.cat([frames[:learned], frames[:learned].flip(3)])
    wanted = torch.cat([steering[:learned], -steering[:learned]])
    judged, truth = frames[learned:], steering[learned:]
    constant = (truth - steering[:learned].median()).abs().mean()
    print(f"{learned} frames to learn from, {len(judged)} to judge; always the median: {constant:.3f}")
    torch.set_num_threads(2)
    bests = []
    for seed in range(1, seeds + 1):
        torch.manual_seed(seed)
        network = build(pilotnet)
        adam = torch.optim.Adam(network.parameters(), 1e-3)
        epochs = []
        for _ in range(EPOCHS):
            for batch in torch.randperm(len(shown)).split(BATCH):
                loss = ((network(shown[batch])[:, 0] - wanted[batch]) ** 2).mean()
                adam.zero_grad()
                loss.backward()
                adam.step()
            with torch.no_grad():
                answers = network(judged)[:, 0]
            error = answers - truth
            correlation = np.corrcoef(answers.numpy(), truth.numpy())[0, 1]
            epochs.append((float((error**2).mean()), float(error.abs().mean()), float(correlation)))
        best, last = min(epochs), epochs[-1]
        bests.append(best)
        print(f"seed {seed}: best epoch {best[1]:.3f}, {best[2]:.3f}; last {last[1]:.3f}, {last[2]:.3f}", flush=True)
    print(f"mean of the best: {np.mean([best[1] for best in bests]):.3f}, {np.mean([best[2] for best in bests]):.3f}")


if __name__ == "__main__":
    main()
