"""Misuse, threads, forks and memory."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from scenes import cameras, cloud

import specula_gs as sg

SIZE = (16, 12)
CALLS = 500


def arguments(rng):
    viewmats, Ks = cameras(rng, 2, *SIZE)
    return dict(**cloud(rng, 5), viewmats=viewmats, Ks=Ks, width=SIZE[0], height=SIZE[1])


ARRAYS = ("means", "quats", "scales", "opacities", "colors", "viewmats", "Ks")
WRONG_VALUES = {
    "means": [np.nan, np.inf],
    "quats": [np.nan, np.inf],
    "scales": [np.nan, np.inf, -1.0],
    "opacities": [np.nan, -0.1, 1.5],
    "colors": [np.nan, -np.inf],
    "viewmats": [np.nan, np.inf],
    "Ks": [np.nan, np.inf],
}
WRONG_OPTIONS = {
    "width": [0, -3, 2**20, 1.5, "wide", None],
    "height": [0, -1, 2**40, [], None],
    "near_plane": [np.nan, "near", -1.0],
    "far_plane": [np.nan, 0.0, None],
    "radius_clip": [-3.0, np.nan, "big"],
    "eps2d": [0.5, np.nan, -0.3],
    "sh_degree": [-1, 4, 2.5, "two", 3],
    "backgrounds": [np.zeros(3), np.zeros((3, 3)), np.full((2, 3), np.nan), "white"],
    "render_mode": ["rgb", None, 3, "d"],
    "sparse_grad": [True],
    "absgrad": [True],
    "rasterize_mode": ["fast", None],
    "distributed": [True],
    "camera_model": ["ortho", "fisheye", "ftheta", None],
    "covars": [np.zeros((5, 3, 3))],
    "with_ut": [True],
    "with_eval3d": [True],
    "radial_coeffs": [np.zeros(6)],
    "rolling_shutter": ["ROLLING_TOP_TO_BOTTOM"],
    "viewmats_rs": [np.eye(4)[None]],
}


def misuse(rng):
    """Arguments of which one is wrong, and its name."""
    call = arguments(rng)
    kind = rng.integers(4)
    if kind == 0:
        name = str(rng.choice(list(WRONG_OPTIONS)))
        options = WRONG_OPTIONS[name]
        call[name] = options[rng.integers(len(options))]
        return call, name
    name = str(rng.choice(ARRAYS))
    array = call[name]
    if kind == 1:
        array = array.copy()
        array.flat[rng.integers(array.size)] = rng.choice(WRONG_VALUES[name])
    elif kind == 2:
        # Colours may have any number of channels.
        axis = rng.integers(array.ndim - (name == "colors"))
        how = rng.integers(3)
        array = [np.delete(array, 0, axis), np.repeat(array, 2, axis), array[..., None, None]][how]
    else:
        others = ["text", None, object(), array.astype(complex), array.astype("datetime64[s]"), [[1], [2, 3]], {}]
        array = others[rng.integers(len(others))]
    call[name] = array
    return call, name


@pytest.mark.parametrize("seed", range(CALLS))
def test_misuse_is_named(seed):
    call, name = misuse(np.random.default_rng(seed))
    with np.errstate(all="ignore"):
        try:
            sg.rasterization(**call)
        except sg.SpeculaError as error:
            assert len(str(error)) > 10, name
            return
    pytest.fail(f"a wrong {name} was accepted: {call[name]!r}")


@pytest.mark.parametrize(
    "viewmat, K",
    [
        (2.0 * np.eye(4), None),
        (np.eye(4)[::-1], None),
        (np.eye(4) + np.eye(4, k=-3), None),
        (None, [[50, 3, 8], [0, 50, 6], [0, 0, 1]]),
        (None, [[-50, 0, 8], [0, 50, 6], [0, 0, 1]]),
        (None, [[50, 0, 8], [0, 50, 6], [0, 0, 2]]),
    ],
)
def test_cameras_that_are_no_pinholes_are_named(viewmat, K):
    call = arguments(np.random.default_rng(0))
    if viewmat is not None:
        call["viewmats"] = np.array([viewmat, viewmat])
    if K is not None:
        call["Ks"] = np.array([K, K])
    with pytest.raises(sg.InvalidInput, match="matri|intrinsics"):
        sg.rasterization(**call)


def test_exceptions_are_python_s_as_well():
    assert issubclass(sg.InvalidInput, ValueError) and issubclass(sg.Unsupported, NotImplementedError)
    assert issubclass(sg.FileError, OSError) and issubclass(sg.UnsupportedKey, KeyError)


SUM = """
import hashlib, sys
sys.path.insert(0, {tests!r})
import numpy as np
from scenes import cameras, cloud
import specula_gs as sg
rng = np.random.default_rng(0)
viewmats, Ks = cameras(rng, 2, 80, 60)
*images, _, vjp = sg.rasterization_vjp(**cloud(rng, 3000, 2), viewmats=viewmats, Ks=Ks, width=80, height=60, sh_degree=2)
arrays = images + [array for array in vjp(*[np.ones_like(image) for image in images]) if array is not None]
assert sg.thread_count() == {threads}
print(hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest())
"""


def test_the_bits_do_not_depend_on_threads():
    def run(threads):
        code = SUM.format(tests=str(Path(__file__).parent), threads=threads)
        environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
        return subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True).stdout

    assert run(1) == run(2) == run(3)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="only Unix forks")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_computes():
    call = arguments(np.random.default_rng(0))
    expected = sg.rasterization(**call)[0]
    child = os.fork()
    if child == 0:
        is_equal = np.array_equal(sg.rasterization(**call)[0], expected)
        os._exit(0 if is_equal else 1)
    for _ in range(200):
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            break
        time.sleep(0.05)
    else:
        os.kill(child, 9)
        os.waitpid(child, 0)
        pytest.fail("the forked process hangs")
    assert os.waitstatus_to_exitcode(status) == 0


def test_threads_of_python_run_meanwhile():
    rng = np.random.default_rng(1)
    viewmats, Ks = cameras(rng, 1, 400, 300)
    call = dict(**cloud(rng, 30_000), viewmats=viewmats, Ks=Ks, width=400, height=300)
    ticks, is_done = [], threading.Event()

    def tick():
        while not is_done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    ticker = threading.Thread(target=tick)
    ticker.start()
    start = time.perf_counter()
    sg.rasterization(**call)
    end = time.perf_counter()
    is_done.set()
    ticker.join()
    inside = [moment for moment in ticks if start < moment < end]
    assert len(inside) >= 3, "the interpreter is released"


def test_calls_from_many_threads_agree():
    call = arguments(np.random.default_rng(2))
    expected = sg.rasterization(**call)[0]
    found = [None] * 8

    def work(index):
        for _ in range(10):
            found[index] = sg.rasterization(**call)[0]

    threads = [threading.Thread(target=work, args=(index,)) for index in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(one, expected) for one in found)


def resident():
    """Bytes of memory in use."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_memory_stays_flat_over_thousands_of_calls():
    rng = np.random.default_rng(3)
    call = arguments(rng)
    wrong = {**call, "quats": call["quats"][:-1]}

    def work(calls):
        for _ in range(calls):
            pictures, _, _, vjp = sg.rasterization_vjp(**call)
            vjp(pictures)
            with pytest.raises(sg.InvalidInput):
                sg.rasterization(**wrong)

    work(300)
    before = resident()
    work(3400)
    assert resident() - before < 8 << 20, "10 200 calls, of which one that keeps a kilobyte would be seen"


def run(*words):
    return subprocess.run([sys.executable, "-m", "specula_gs", *words], capture_output=True, text=True)


def test_the_program_is_in_the_package(tmp_path):
    """With its exit codes, messages and the words of its help."""
    done = run("--version")
    assert done.returncode == 0 and done.stdout.startswith("specula "), done
    done = run("train", str(tmp_path / "nothing"), "-m", str(tmp_path / "model"))
    assert done.returncode == 2 and "nothing" in done.stderr and "Traceback" not in done.stderr, done
    script = Path(sys.executable).with_name("specula")
    done = subprocess.run([script, "render", "--help"], check=True, capture_output=True, text=True)
    assert "specula render" in done.stdout


def test_self_test_of_the_module():
    done = subprocess.run([sys.executable, "-m", "specula_gs"], check=True, capture_output=True, text=True)
    assert done.stdout.startswith(f"specula-gs {sg.__version__}") and "passed" in done.stdout
