# SPDX-License-Identifier: Apache-2.0
"""A sweep of 12 runs on a real Slurm cluster of one node: cancels one task and kills one training program; a second
call submits only these two, and the table is complete. Skipped (77) if Slurm is not installed.

    python3 tests/scripts/slurm_sweep_test.py BUILD_BIN [FOLDER_THAT_STAYS]
"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.argv[1]).resolve()
SWEEP = """columns: [psnr, ssim, minutes]
seeds: [0, 1, 2, 3]
scenes: [{name: tiny, config: tiny.yaml}]
rows:
  - {name: blur, config: blur.yaml}
  - {name: edi, set: [objective.target=edi]}
  - {name: plain, set: [objective.target=blurry]}
"""
TINY = f"""extends: {ROOT / "configs" / "paper.yaml"}
dataset: {{path: data}}
init: {{points: 300}}
objective: {{target: none}}
train: {{iterations: 150}}
checkpoint: {{every: 30}}
"""


def say(text):
    print(text, flush=True)


def call(*command, code=0):
    """Runs a command and fails the test on another exit code; None accepts any."""
    say("+ " + " ".join(str(part) for part in command))
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    say((done.stdout + done.stderr).rstrip())
    if code is not None and done.returncode != code:
        sys.exit(f"FAILED with {done.returncode}, expected {code}")
    return done


def queue():
    """Array index and state of the remaining tasks."""
    out = subprocess.run(["squeue", "--noheader", "--array", "--format=%K %T"], capture_output=True, text=True, check=True).stdout
    return dict(line.split() for line in out.splitlines())


def wait_for(what, condition, seconds=240):
    end = time.time() + seconds
    while time.time() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.1)
    sys.exit(f"FAILED: waited {seconds} s for {what}; queue: {queue()}")


def trainer_of(run):
    """The process that trains into this folder."""
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0") if entry.name.isdigit() else []
        except OSError:
            continue
        if words and words[0].endswith(b"jade_train") and str(run).encode() in words:
            return int(entry.name)
    return None


def scenario(folder):
    (folder / "sweep.yaml").write_text(SWEEP)
    (folder / "tiny.yaml").write_text(TINY)
    (folder / "blur.yaml").write_text("objective: {edi_supervision: false, simulation: false}\n")
    out = folder / "out"
    call(BIN / "jade_simulate", "--quiet", "--config", ROOT / "configs/simulate/demo.yaml", "--set", "simulate.width=64", "--set",
         "simulate.height=48", "--set", "simulate.focal_px=80", "--set", "simulate.exposures=3", "--output", folder / "data")
    sweep = [BIN / "jade_sweep", "--sweep", folder / "sweep.yaml", "--output", out, "--device", "cpu", "--launcher", "slurm"]
    call(*sweep)
    ids = (out / "slurm/list_1.txt").read_text().split()
    assert len(ids) == 12, ids
    # Runs that are in the queue are not submitted twice.
    again = call(*sweep)
    assert "submitted" not in again.stderr and "12 runs are in the queue already" in again.stderr

    running = wait_for("two running tasks", lambda: (lambda r: r if len(r) >= min(2, os.cpu_count()) else None)(
        [index for index, state in queue().items() if state == "RUNNING"]))
    cancelled = running[0]
    wait_for("its first checkpoint", lambda: list((out / "runs" / ids[int(cancelled)] / "checkpoints").glob("*.pt")))
    job = (out / "slurm/jobs.txt").read_text().split()[0]
    call("scancel", f"{job}_{cancelled}")
    killed = next(index for index in sorted(queue(), key=int) if index not in running)
    pid = wait_for("a training program to kill", lambda: trainer_of(out / "runs" / ids[int(killed)]))
    say(f"kill -9 {pid}, which trains {ids[int(killed)]}")
    os.kill(pid, 9)
    wait_for("the queue to empty", lambda: not queue())
    # The exit code reports a killed run until it is submitted again.
    call(*sweep[:-2], "--table", code=4)
    before = (out / "table.md").read_text()
    say(before[:before.index("## Columns")])
    assert "10 of 12 runs finished" in before and "killed by signal 9" in before and "interrupted" in before

    second = call(*sweep)
    assert "of 2 runs" in second.stderr
    call(*sweep, "--wait")
    table = (out / "table.md").read_text()
    say(table[:table.index("## Columns")])
    assert "12 of 12 runs finished" in table and "What is missing" not in table
    for index in (cancelled, killed):
        outcome = json.loads((out / "tasks" / (ids[int(index)] + ".json")).read_text())
        assert outcome["attempts"] >= 2 and outcome["exit_code"] == 0, outcome
    log = (out / "tasks" / (ids[int(cancelled)] + ".log")).read_text()
    assert "resumed from" in log, log
    say("the cancelled run went on from its checkpoint; the table is complete")


def main():
    path = os.environ["PATH"] = os.environ["PATH"] + ":/usr/sbin:/sbin"
    if any(shutil.which(name, path=path) is None for name in ("slurmctld", "slurmd", "sbatch", "munged")) or os.getuid() != 0:
        say("SKIPPED: needs root and the packages slurmctld, slurmd, slurm-client and munge")
        return 77
    stays = Path(sys.argv[2]).resolve() if len(sys.argv) > 2 else None
    folder = stays or Path(tempfile.mkdtemp(prefix="jade-slurm-"))
    folder.mkdir(parents=True, exist_ok=True)
    cluster = folder / "slurm"
    try:
        started = call(ROOT / "scripts/slurm_local.sh", "start", cluster, code=None)
        if started.returncode != 0:
            return started.returncode
        os.environ["SLURM_CONF"] = str(cluster / "slurm.conf")
        scenario(folder)
    finally:
        call(ROOT / "scripts/slurm_local.sh", "stop", cluster, code=None)
        if not stays:
            shutil.rmtree(folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
