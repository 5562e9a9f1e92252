"""Rows A7 to A10 of document A in the simulator, from recordings to a fine-tuned network.

    python benches/document_a.py SENDA FOLDER [--mobilenet [WEIGHTS]]

SENDA is the program, FOLDER is made and holds everything. Sixteen runs of a driver with a person's unrest on six circuits and five
floors are learned, two other circuits judge; then the network drives all of them both ways, the places where it was worst are
driven again by the person from beside the lane's middle, and the network is fine-tuned with them. `--mobilenet` also trains
document A's first network over the backbone in WEIGHTS, a safetensors or ONNX file (docs/networks.md tells where one comes from);
without it the backbone is random, which shows the effort and not the quality.
Only Python's own library is needed. What is finished is not done again.
"""

import json
import pathlib
import subprocess
import sys

FLOORS = ["plain", "wood", "carpet", "tiles", "dark-speckled"]
HUMAN = ["wander_m=0.02", "wander_s=2.0", "unrest=0.02", "settle_s=0.5", "pedal_per_mps=6.0"]
SPEED_MPS = "0.16"  # the document's 20 of 100
SERVO_DEG = "50"  # full lock, in the servo degrees of document A
KNOWN = [f"circuit-{number}" for number in range(1, 7)]
JUDGES = ["unseen-1", "unseen-2"]
# As document A has it: Glorot's first weights, frames as they are and mirrored.
PLAIN = """
initialisation = "glorot"
augmentation = { mirror = 0.0, brightness = 0.0, contrast = 0.0, colour = 0.0, shadow = 0.0 }
"""
# The same with what senda does to frames.
TREATED = "augmentation = { shift = 0.03, patches = 0.3, glare = 0.3, blur = 0.2, noise = 4.0 }"


def plan(treatment, epochs, rate, both_ways=True):
    """An experiment file for `senda train`."""
    both_ways = str(both_ways).lower()
    return f"[training]\nbatch = 32\nepochs = {epochs}\nlearning_rate = {rate}\nboth_ways = {both_ways}\n{treatment}\n"


def main():
    program = str(pathlib.Path(sys.argv[1]).resolve())
    folder = pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)

    def senda(*arguments):
        done = subprocess.run([program, *map(str, arguments), "--json"], capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"senda {' '.join(map(str, arguments))}\n{done.stderr}")
        return json.loads(done.stdout)

    def record(where, world, floor, seed, seconds, station_m, reverse, start=()):
        """One run of the person; each lies in its own folder."""
        to = folder / where / f"{world}-{seed}"
        if to.exists():
            return
        options = [part for option in HUMAN for part in ("--option", option)]
        direction = ["--reverse"] if reverse else []
        floor = ["--floor", floor] if floor else []
        senda("drive", "--world", world, "--vehicle", "picar", "--driver", "human", "--speed", SPEED_MPS, *options, *floor, *direction,
              "--seed", seed, "--time-limit", seconds, "--start-station", station_m, *start, "--record", to)  # fmt: skip

    def train(name, data, experiment, *more):
        out = folder / f"{name}.json"
        if not out.exists():
            (folder / f"{name}.toml").write_text(experiment)
            result = senda("train", *[folder / part for part in data], "--validation", folder / "judging", "--crop-top", 0.5,
                           "--full-lock-deg", SERVO_DEG, "--plan", folder / f"{name}.toml", "--out", folder / f"{name}.senda", *more)  # fmt: skip
            out.write_text(json.dumps(result))
        result = json.loads(out.read_text())
        print(name, f"best epoch {result['best_epoch']}, {result['wall_s']:.0f} s")
        for part in ("on_training", "on_validation"):
            errors = result[part]
            print(f"  {part}: {errors['count']} frames, MSE {errors['mean_squared_deg2']:.1f} deg², "
                  f"mean error {errors['mean_absolute_deg']:.1f}°, correlation {errors['correlation']:.3f}")  # fmt: skip

    def drive(name):
        """The network on every circuit both ways: completed, and where it was worst."""
        out = folder / f"{name}-drives.json"
        if not out.exists():
            runs = []
            for world in KNOWN + [f"unseen-{number}" for number in range(1, 5)]:
                for reverse in (False, True):
                    direction = ["--reverse"] if reverse else []
                    run = senda("drive", "--world", world, "--vehicle", "picar", "--driver", "neural", "--model",
                                folder / f"{name}.senda", "--speed", SPEED_MPS, *direction)  # fmt: skip
                    runs.append({key: run[key] for key in ("world", "reversed", "completed", "distance_m", "lane_error_max_m",
                                                           "lane_error_mean_m", "first_departure_s")})  # fmt: skip
            out.write_text(json.dumps(runs))
        runs = json.loads(out.read_text())
        for what, chosen in (("known", KNOWN), ("unseen", [f"unseen-{number}" for number in range(1, 5)])):
            part = [run for run in runs if run["world"] in chosen]
            done = [run for run in part if run["completed"]]
            print(f"  {what} circuits: {len(done)} of {len(part)} completed; failed: "
                  + ", ".join(run["world"] + (" reversed" if run["reversed"] else "") for run in part if not run["completed"]))  # fmt: skip
        return runs

    # A7: 16 runs of 14.8 s at 20 frames a second, and two circuits that judge.
    for number in range(16):
        world = KNOWN[number % 6]
        record("learning", world, FLOORS[number % 5], number + 1, 14.8, 1.1 * (number // 6), number % 2 == 1)
    for number, world in enumerate(JUDGES):
        record("judging", world, None, 101 + number, 9.9, 0.3, number == 1)

    # A9, A10, as written and with more treatment of the frames.
    for mark, treatment in (("", PLAIN), ("-treated", TREATED)):
        first, corrected = f"a9{mark}", f"a10{mark}"
        train(first, ["learning"], plan(treatment, 10, 1e-3), "--network", "pilotnet")
        runs = drive(first)
        worst = sorted((run for run in runs if run["world"] in KNOWN),
                       key=lambda run: (run["completed"], -run["lane_error_max_m"]))[:6]  # fmt: skip
        for number, run in enumerate(worst):
            # Document A added 704 frames: six times six seconds, from both sides of the middle.
            station_m = max(run["distance_m"] - 0.6, 0.1) if not run["completed"] else 0.5
            aside = ["--start-offset", "0.06" if number % 2 else "-0.06", "--start-heading-deg", "8" if number % 2 else "-8"]
            record(f"failures{mark}", run["world"], None, 201 + number, 6.0, station_m, run["reversed"], aside)
        data = ["learning", f"failures{mark}"]
        train(corrected, data, plan(treatment, 5, 3e-5), "--from", folder / f"{first}.senda")
        drive(corrected)

    # A8: the head alone learns, and no frame is mirrored.
    if "--mobilenet" in sys.argv:
        weights = sys.argv[sys.argv.index("--mobilenet") + 1 :]
        adopted = ["--from", weights[0]] if weights else []
        train("a8", ["learning"], plan(PLAIN, 10, 1e-3, both_ways=False), "--network", "mobilenetv2-head", *adopted)
        drive("a8")


if __name__ == "__main__":
    main()
