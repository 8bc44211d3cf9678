"""Checkpoints: a run goes on from one to the last bit, and nothing but a whole one of the same model is read."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import random
import resource
import struct
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lithoform import dem, generate
from lithoform.errors import FileFormatError, OutputError, SceneError
from lithoform.presets import database_recipe

SOFT = dem.TABLE_10.softened(0.01)
START = struct.Struct("<8sIQ32sI")


@pytest.fixture(scope="module")
def falling() -> tuple[dem.Model, dem.State, float]:
    """72 stones that fall in a cylinder under a servo plane, most of them in contact; and the time step."""
    classes = ("cube", "plate", "column", "blade")
    meshes = [generate(database_recipe(name, seed=1, triangles=512)).mesh for name in classes]
    shapes = [dem.Shape.from_mesh(mesh) for mesh in meshes]
    reach = max(shape.bounding_radius for shape in shapes)
    number = np.arange(72)
    place = np.stack([number % 9 // 3 - 1, number % 3 - 1, number // 9 + 0.55], axis=1) * 2.01 * reach
    generator = np.random.default_rng(1)
    velocity = generator.normal(size=(72, 3)) * 0.1 - [0.0, 0.0, 0.3]
    lid = dem.Plane(
        point=(0.0, 0.0, place[:, 2].max() + 1.01 * reach),
        normal=(0.0, 0.0, -1.0),
        motion=dem.Servo(force=5.0, mass=0.3, time=0.05, max_speed=0.4),
    )
    model = dem.Model(
        shapes=shapes,
        materials=(SOFT,),
        shape=number % 4,
        walls=(dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)), dem.Cylinder(radius=3.9 * reach), lid),
    )
    state = dem.State.at_rest(model, place, generator.normal(size=(72, 4)), velocity)
    run = dem.simulate(model, state, until=0.11, device="cpu", threads=1)
    return model, run.state, run.dt


def steps(model: dem.Model, state: dem.State, dt: float, count: int, threads: int = 1) -> dem.State:
    return dem.simulate(model, state, until=state.time + count * dt, dt=dt, device="cpu", threads=threads).state


def assert_same(a: dem.State, b: dem.State) -> None:
    assert (a.step, a.clock, a.lag, a.fresh) == (b.step, b.clock, b.lag, b.fresh)
    different = [name for name, array in a.arrays().items() if array.tobytes() != b.arrays()[name].tobytes()]
    assert different == []
    assert [array.dtype for array in a.arrays().values()] == [array.dtype for array in b.arrays().values()]


@pytest.fixture
def small(tmp_path) -> tuple[Path, dem.Model, dem.State]:
    """A checkpoint of three spheres between a plane and a cylinder."""
    model = spheres()
    state = dem.State.at_rest(model, [[0, 0, 0.01], [0, 0, 0.02999], [0.03, 0, 0.01]], velocity=np.full((3, 3), 0.01))
    state = steps(model, state, 1e-6, 20)
    return dem.write_checkpoint(tmp_path / "a.ckpt", model, state), model, state


def spheres(**other: object) -> dem.Model:
    given = {
        "shapes": (dem.Shape.sphere(0.01),),
        "materials": (SOFT,),
        "shape": [0, 0, 0],
        "walls": (dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)), dem.Cylinder(radius=0.06)),
    }
    return dem.Model(**{**given, **other})


@contextlib.contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """As on a disk that is full after so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize(("before", "after"), [(1, 1), (2, 2), (1, 2)])
def test_a_run_goes_on_to_the_last_bit(falling, tmp_path, before, after):
    model, state, dt = falling
    assert (state.contact_radius > 0.0).sum() > 30
    assert (state.wall_contact_radius > 0.0).sum() > 5
    assert abs(state.wall_speed[2]) > 0.0
    whole = steps(model, state, dt, 1000, threads=after)
    first = steps(model, state, dt, 400, threads=before)
    dem.write_checkpoint(tmp_path / "run.ckpt", model, first)
    second = steps(model, dem.read_checkpoint(tmp_path / "run.ckpt", model), dt, 600, threads=after)
    assert whole.step == state.step + 1000
    assert_same(whole, second)
    # The state does move in this time, and contacts come and go.
    assert np.abs(whole.position - state.position).max() > 1e-5
    assert not np.array_equal(whole.pair, state.pair) or not np.array_equal(
        whole.contact_radius > 0.0, state.contact_radius > 0.0
    )


def test_a_run_goes_on_from_before_its_first_step(falling, tmp_path):
    model, _, _ = falling
    start = dem.State.at_rest(model, np.arange(216).reshape(72, 3) % 72 * 1e-3 + [0, 0, 0.1])
    dem.write_checkpoint(tmp_path / "a", model, start)
    again = dem.read_checkpoint(tmp_path / "a", model)
    assert again.fresh
    assert again.clock == (0.0, 0, 0.0)
    assert_same(start, again)


def test_the_same_state_gives_the_same_bytes_and_comes_back(falling, tmp_path):
    model, state, _ = falling
    one = dem.write_checkpoint(tmp_path / "one", model, state)
    assert_same(dem.read_checkpoint(one, model), state)
    two = dem.write_checkpoint(tmp_path / "two", model, dem.read_checkpoint(one, model))
    assert one.read_bytes() == two.read_bytes()
    assert b"numpy" not in one.read_bytes()  # no pickle
    size = sum(array.nbytes for array in state.arrays().values())
    assert one.stat().st_size - size < 4000


def test_a_text_path_and_a_file_that_is_replaced(small):
    path, model, state = small
    dem.write_checkpoint(str(path), model, replace(state, step=99))
    assert dem.read_checkpoint(str(path), model).step == 99


def test_every_altered_byte_is_noticed(small):
    path, model, _ = small
    whole = path.read_bytes()
    generator = random.Random(3)
    for at in [*range(START.size), *(generator.randrange(len(whole)) for _ in range(300))]:
        damaged = bytearray(whole)
        damaged[at] ^= 1 << generator.randrange(8)
        path.write_bytes(damaged)
        with pytest.raises(FileFormatError, match=r"is damaged|is not a checkpoint|is cut short|has format"):
            dem.read_checkpoint(path, model)


def test_a_file_cut_anywhere_or_too_long_is_refused(small):
    path, model, _ = small
    whole = path.read_bytes()
    for length in (*range(8), 8, 20, START.size - 1, START.size, START.size + 9, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        said = "is not a checkpoint of lithoform" if length < 8 else f"is cut short: it has {length} "
        with pytest.raises(FileFormatError, match=said):
            dem.read_checkpoint(path, model)
    path.write_bytes(whole + b"\0")
    with pytest.raises(FileFormatError, match="is damaged"):
        dem.read_checkpoint(path, model)


def test_a_foreign_file_a_folder_and_no_file(tmp_path):
    model = spheres()
    np.savez(tmp_path / "a.npz", position=np.zeros((3, 3)))
    (tmp_path / "b.json").write_text("{}")
    (tmp_path / "text").write_bytes(b"\x89LFDEM\n" + bytes(100))  # line ends changed on the way
    for name in ("a.npz", "b.json", "text"):
        with pytest.raises(FileFormatError, match="is not a checkpoint of lithoform: expected a file that"):
            dem.read_checkpoint(tmp_path / name, model)
    with pytest.raises(FileFormatError, match="cannot be read: no such file"):
        dem.read_checkpoint(tmp_path / "none", model)
    with pytest.raises(FileFormatError, match="cannot be read: is a directory"):
        dem.read_checkpoint(tmp_path, model)


def forged(whole: bytes, version: int = 1, text: bytes | None = None, arrays: bytes | None = None) -> bytes:
    """A checkpoint with a right hash of what somebody else put into it."""
    size = START.unpack(whole[: START.size])[4]
    text = whole[START.size : START.size + size] if text is None else text
    content = text + (whole[START.size + size :] if arrays is None else arrays)
    start = START.pack(b"\x89LFDEM\r\n", version, len(content), b"", len(text))
    digest = hashlib.sha256(start + content).digest()
    return START.pack(b"\x89LFDEM\r\n", version, len(content), digest, len(text)) + content


def test_a_newer_version_is_refused_by_name(small):
    path, model, _ = small
    assert forged(path.read_bytes()) == path.read_bytes()
    path.write_bytes(forged(path.read_bytes(), version=2))
    with pytest.raises(FileFormatError, match=r"has format 2 .* reads up to 1: read it with a newer lithoform"):
        dem.read_checkpoint(path, model)
    path.write_bytes(path.read_bytes()[: START.size])  # whatever the rest of it looks like
    with pytest.raises(FileFormatError, match="has format 2"):
        dem.read_checkpoint(path, model)


def test_numbers_that_lie_with_a_right_hash_are_refused(small):
    path, model, state = small
    assert len(state.pair)
    whole = path.read_bytes()
    size = START.unpack(whole[: START.size])[4]
    header = json.loads(whole[START.size : START.size + size])
    arrays = whole[START.size + size :]
    lies = (
        {"pairs": 1 << 60}, {"pairs": -1}, {"pairs": 1.0}, {"pairs": True}, {"blocks": 4}, {"walls": None},
        {"step": -1}, {"step": "1"}, {"clock": [0, 0]}, {"clock": None}, {"clock": [1e999, 0, 1]}, {"lag": "x"},
        {"model": []}, {"model": {"blocks": 1}}, {"fresh": 1}, {"fields": header["fields"][:-1]}, {"fields": None},
    )  # fmt: skip
    for lie in lies:
        path.write_bytes(forged(whole, text=json.dumps({**header, **lie}).encode()))
        with pytest.raises((FileFormatError, SceneError)) as caught:
            dem.read_checkpoint(path, model)
        assert str(caught.value).startswith(str(path))
    for text in (b"", b"[]", b"{", b"\xff", json.dumps({"model": header["model"]}).encode()):
        path.write_bytes(forged(whole, text=text))
        with pytest.raises(FileFormatError, match="that this version reads"):
            dem.read_checkpoint(path, model)
    sizes = {name: array.nbytes for name, array in state.arrays().items()}
    before = dict(zip(sizes, np.cumsum([0, *sizes.values()]).tolist(), strict=False))
    lying = [arrays[:-8], b"", np.full(3, np.nan).tobytes() + arrays[24:]]
    # Indices that point out of the model: the kernels would follow them.
    for name in ("pair", "simplex", "wall_candidates", "wall_candidate_count"):
        at = before[name] + (4 if name == "simplex" else 0)
        indices = (-1, 3, 1 << 30) if name == "pair" else (-1, 1 << 30)
        lying += [arrays[:at] + struct.pack("<i", index) + arrays[at + 4 :] for index in indices]
    for changed in lying:
        path.write_bytes(forged(whole, arrays=changed))
        with pytest.raises(FileFormatError, match="that this version reads"):
            dem.read_checkpoint(path, model)


def test_one_of_another_model_is_refused(small):
    path, model, state = small
    floor, mould = model.walls
    iron = replace(SOFT, density=7800.0)
    others = {
        "shapes, blocks or materials": [
            spheres(scale=[1, 1, 1.0000001]), spheres(shapes=(dem.Shape.sphere(0.011),)), spheres(materials=(iron,)),
            spheres(shape=[0, 0]), spheres(shape=[0] * 4), spheres(materials=(SOFT, iron)),
        ],
        "walls": [
            spheres(walls=()), spheres(walls=(floor,)), spheres(walls=(mould, floor)), spheres(walls=(floor, floor)),
            spheres(walls=(replace(floor, point=(0, 0, -0.01)), mould)),
            spheres(walls=(floor, replace(mould, radius=0.07))),
        ],
        "pairs of materials": [spheres(pairs={(0, 0): dem.PairConstants(sliding_friction=0.1)})],
    }  # fmt: skip
    for words, models in others.items():
        for other in models:
            with pytest.raises(SceneError, match=f"of another model: its {words} are not those"):
                dem.read_checkpoint(path, other)
    # A protocol goes on with other motions, gravity and damping.
    pressed = dem.Servo(force=1.0, mass=1.0)
    for other in (model.with_motion(0, pressed), replace(model, gravity=(0, 0, 0)), replace(model, local_damping=0.3)):
        assert_same(dem.read_checkpoint(path, other), state)


def test_a_state_of_another_model_is_not_written(small, tmp_path):
    path, _, state = small
    before = path.read_bytes()
    with pytest.raises(SceneError, match="expected a state of 2 blocks, got one of 3"):
        dem.write_checkpoint(path, spheres(shape=[0, 0]), state)
    assert path.read_bytes() == before
    assert [*tmp_path.iterdir()] == [path]


def test_a_full_disk_leaves_the_former_one(small, tmp_path):
    path, model, state = small
    before = path.read_bytes()
    with files_of_at_most(1000), pytest.raises(OutputError, match=r"cannot write .*a\.ckpt: the file would be larger"):
        dem.write_checkpoint(path, model, replace(state, step=99))
    assert path.read_bytes() == before
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_leaves_the_former_one(small, tmp_path):
    path, model, state = small
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="permission is denied"):
            dem.write_checkpoint(path, model, replace(state, step=99))
    finally:
        tmp_path.chmod(0o700)
    assert_same(dem.read_checkpoint(path, model), state)


def test_a_folder_that_is_missing(small, tmp_path):
    _, model, state = small
    with pytest.raises(OutputError, match="its folder does not exist"):
        dem.write_checkpoint(tmp_path / "none" / "a", model, state)


def test_killed_while_it_writes_the_file_is_always_a_whole_one(tmp_path):
    code = """
        import os, random, signal, sys, time
        import numpy as np
        from dataclasses import replace
        from lithoform import dem
        path, count = sys.argv[1], 3000
        walls = (dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),)
        model = dem.Model(shapes=(dem.Shape.sphere(0.001),), materials=(dem.TABLE_10,), shape=[0] * count, walls=walls)
        state = dem.State.at_rest(model, np.arange(3 * count).reshape(count, 3))
        dem.write_checkpoint(path, model, state)
        moments, seen = random.Random(7), set()
        for kill in range(25):
            child = os.fork()
            if child == 0:
                step = 1000 * kill
                while True:
                    step += 1
                    moved = replace(state, step=step, velocity=np.full((count, 3), float(step)))
                    dem.write_checkpoint(path, model, moved)
            time.sleep(moments.uniform(0.005, 0.06))
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            found = dem.read_checkpoint(path, model)
            assert (found.velocity == found.step).all()
            seen.add(found.step)
        print(len(seen))
    """
    command = [sys.executable, "-W", "error", "-c", textwrap.dedent(code), str(tmp_path / "a.ckpt")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 5  # the kills met it at work
    assert any(path.name.endswith(".partial") for path in tmp_path.iterdir())


def test_what_a_run_has_done_is_kept_when_a_report_fails(falling, tmp_path):
    model, state, dt = falling
    path = tmp_path / "run.ckpt"

    def fails(model, now):
        if now.step >= state.step + 60:
            raise OutputError("cannot write: the disk is full.")

    until = state.time + 100 * dt
    with pytest.raises(OutputError, match="the disk is full"):
        dem.simulate(model, state, until=until, dt=dt, report=20 * dt, on_report=fails, checkpoint=path, device="cpu")
    kept = dem.read_checkpoint(path, model)
    assert state.step + 60 <= kept.step < state.step + 100
    rest = dem.simulate(model, kept, until=until, dt=dt, device="cpu", checkpoint=path)
    assert_same(rest.state, steps(model, state, dt, 100))
    assert_same(dem.read_checkpoint(path, model), rest.state)
