"""QR codes with zbar and OpenCV over a folder of JPEG frames.

    python codes.py FOLDER

Both get the grey upper part of the frame that senda searches (0.62 of its height). One thread; of each frame the best of five
rounds, averaged over the frames. Prints one line of JSON: time per frame (ms), codes, and those as wide as the mission asks for.
Needs opencv-python-headless, numpy, pyzbar and the system's libzbar0.
"""

import json
import pathlib
import sys
import time

import cv2
import numpy as np
from pyzbar import pyzbar

cv2.setNumThreads(1)
ROUNDS, PART, LEAST_PART = 5, 0.62, 0.085


def zbar(grey):
    found = pyzbar.decode(grey, symbols=[pyzbar.ZBarSymbol.QRCODE])
    return [max(code.rect.width, code.rect.height) for code in found]


def opencv(grey, detector=cv2.QRCodeDetector()):
    ok, texts, corners, _ = detector.detectAndDecodeMulti(grey)
    if not ok:
        return []
    sides = [max(np.linalg.norm(np.roll(points, 1, 0) - points, axis=1)) for points in corners]
    return [side for text, side in zip(texts, sides) if text]


def main():
    frames = [cv2.imread(str(path)) for path in sorted(pathlib.Path(sys.argv[1]).glob("*.jpg"))]
    report = {"who": "peers", "frames": len(frames)}
    for name, read in [("zbar", zbar), ("opencv", opencv)]:
        total, codes, near = 0.0, 0, 0
        for frame in frames:
            best = float("inf")
            for _ in range(ROUNDS):
                begin = time.perf_counter()
                # As senda does: from the colour frame to the text.
                grey = cv2.cvtColor(frame[: int(PART * frame.shape[0])], cv2.COLOR_BGR2GRAY)
                sides = read(grey)
                best = min(best, time.perf_counter() - begin)
            total += best
            codes += len(sides)
            near += sum(bool(side >= LEAST_PART * frame.shape[1]) for side in sides)
        report[name] = {"ms": round(1e3 * total / len(frames), 3), "codes": codes, "near_codes": near}
    print(json.dumps(report))


main()
