"""Stores of studies: what is missing or damaged is computed again, and nothing else changes."""

import shutil

import numpy as np
import pytest
from small_study import PD, READING, content, files_of

import flexarm as fa
from flexarm.cases.studies import store as stores
from flexarm.model import StudySpec, file_text

zarr = pytest.importorskip("zarr", reason="it comes with the extra: pip install 'flexarm[cluster]'")


@pytest.fixture(scope="module")
def study():
    drives = {"torque": {"kind": "rigid_inverse_dynamics"}, "PD": PD}
    return fa.Study(content(drives=drives, hardware=READING))


@pytest.fixture(scope="module")
def undisturbed(study, tmp_path_factory):
    place = tmp_path_factory.mktemp("undisturbed") / "a.zarr"
    study.run(place, workers=1, chunk=5)
    return place


@pytest.fixture
def copied(undisturbed, tmp_path):
    return shutil.copytree(undisturbed, tmp_path / "b.zarr")


@pytest.mark.thorough
def test_store_equals_the_results_in_memory(study, undisturbed):
    table = fa.read_study(undisturbed)
    assert table.equals(study.run(workers=1, chunk=12))
    assert table.sizes == {"sample": 12, "controller": 2, "plant": 1, "reference": 1}
    assert np.isfinite(table["tip_error_rms"].values).all()
    assert table.attrs["software"].startswith("Python")
    again = undisturbed.with_name("again.yaml")
    again.write_text(table.attrs["study"])
    assert fa.Study(again).run(workers=1, chunk=3).equals(table)


@pytest.mark.thorough_cases("no store", "exchanged")
@pytest.mark.parametrize(
    "damage",
    [
        lambda place: (place / "checksum/c/1").unlink(),
        lambda place: (place / "metrics/c/0/0/0/0/0").unlink(),
        lambda place: (place / "metrics/c/2/0/0/0/0").write_bytes(b""),
        lambda place: (place / "parameters/c/1/0").write_bytes(
            (place / "parameters/c/0/0").read_bytes()
        ),
        lambda place: (place / "metrics/c/0/0/0/0/0.5f.partial").write_bytes(b"half"),
        shutil.rmtree,
    ],
    ids=["not recorded", "lost", "truncated", "exchanged", "interrupted", "no store"],
)
def test_resumed_store_is_identical(damage, study, undisturbed, copied):
    damage(copied)
    assert files_of(copied) != files_of(undisturbed)
    study.run(copied, workers=1, chunk=5, resume=True)
    assert files_of(copied) == files_of(undisturbed)


def test_complete_chunks_are_not_executed_again(study, copied, monkeypatch):
    executed = []
    write = stores.Store.write
    monkeypatch.setattr(
        stores.Store, "write", lambda own, i, found: executed.append(i) or write(own, i, found)
    )
    (copied / "checksum/c/1").unlink()
    study.run(copied, workers=1, resume=True)
    study.run(copied, workers=1, resume=True)
    assert executed == [1]


def test_results_so_far_can_be_read(study, undisturbed, copied):
    (copied / "checksum/c/1").unlink()
    so_far, table = fa.read_study(copied), fa.read_study(undisturbed)
    assert so_far.sample.values.tolist() == [0, 1, 2, 3, 4, 10, 11]
    assert so_far.equals(table.isel(sample=so_far.sample.values))


def test_store_without_results_has_no_samples(undisturbed, copied):
    shutil.rmtree(copied / "checksum/c")
    assert fa.read_study(copied).equals(fa.read_study(undisturbed).isel(sample=[]))


@pytest.mark.thorough
def test_disk_that_is_full_stops_and_resumes(study, undisturbed, tmp_path):
    resource = pytest.importorskip("resource", reason="Windows has no limits of files")
    place = tmp_path / "b.zarr"
    missing = stores.Store.missing
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(*given):  # after the store is created, no file may exceed 8 bytes
        resource.setrlimit(resource.RLIMIT_FSIZE, (8, limits[1]))
        return missing(*given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stores.Store, "missing", fill)
        try:
            with pytest.raises(fa.InputError, match=r"could not be written: .*\. Everything that"):
                study.run(place, workers=1, chunk=5)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not (place / "checksum/c").exists()
    study.run(place, workers=1, resume=True)
    assert files_of(place) == files_of(undisturbed)


def test_store_that_exists_is_not_overwritten(study, copied):
    before = files_of(copied)
    with pytest.raises(fa.InputError, match=r"exists\. Continue it with resume=True"):
        study.run(copied, workers=1)
    with pytest.raises(fa.InputError, match="belongs to another study"):
        fa.Study(content(13)).run(copied, workers=1, resume=True)
    assert files_of(copied) == before


def test_store_of_other_versions_is_not_continued(study, copied, monkeypatch):
    monkeypatch.setattr(stores, "software_versions", lambda: "numpy 9")
    with pytest.raises(fa.InputError, match="cannot be continued with numpy 9"):
        study.run(copied, workers=1, resume=True)


def test_other_folders_are_refused(study, tmp_path):
    (tmp_path / "text.txt").write_text("mine")
    with pytest.raises(fa.InputError, match="must be the folder of a study"):
        study.run(tmp_path, workers=1, resume=True)
    assert files_of(tmp_path) == {"text.txt": b"mine"}


@pytest.mark.thorough
def test_verify_finds_changed_numbers(study, copied):
    assert study.verify(copied, 12) == []
    store = stores.Store(copied)
    outcomes = store.read(1)
    outcomes.metrics[2, 0, 0, 0, 0] *= 1.0 + 2e-16  # the last digit of sample 7
    store.write(1, outcomes)
    assert study.verify(copied, 12) == [7]
    (copied / "metrics/c/1/0/0/0/0").unlink()
    with pytest.raises(fa.InputError, match="1 of 3 chunks missing or damaged"):
        study.verify(copied, 12)


@pytest.mark.thorough
@pytest.mark.parametrize("chunk", [5, 3])
def test_folder_of_another_study_is_used_anew(chunk, study, tmp_path):
    """In one process: a worker keeps no store whose folder was deleted and created again."""
    place = tmp_path / "b.zarr"
    study.run(place, workers=1, chunk=5)
    shutil.rmtree(place)
    other = study if chunk == 3 else fa.Study(content(drives={"other": PD}))
    other.run(place, workers=1, chunk=chunk)
    assert fa.read_study(place).equals(other.run(workers=1, chunk=12))
    assert other.verify(place, 12) == []


def test_task_of_another_study_is_refused(study, undisturbed):
    digest = stores.Store(undisturbed).digest
    other = stores.digest_of(file_text(StudySpec(**content(13))), 5)
    assert stores.opened(str(undisturbed), digest).digest == digest
    with pytest.raises(fa.InputError, match="belongs to another study"):
        stores.opened(str(undisturbed), other)


@pytest.mark.parametrize("content", [b"", b"garbage", None], ids=["empty", "damaged", "lost"])
@pytest.mark.parametrize("name", ["metrics/c/1/0/0/0/0", "parameters/c/1/0"])
def test_damaged_chunks_are_not_results(content, name, undisturbed, copied):
    (copied / name).unlink() if content is None else (copied / name).write_bytes(content)
    with pytest.warns(fa.FlexarmWarning, match="leaves out 1 of 3 chunks, whose files"):
        found = fa.read_study(copied)
    assert found.equals(fa.read_study(undisturbed).isel(sample=[0, 1, 2, 3, 4, 10, 11]))


def test_damaged_checksum_is_executed_again(study, undisturbed, copied):
    """A loss of power may leave an empty file."""
    (copied / "checksum/c/1").write_bytes(b"")
    assert fa.read_study(copied).sizes["sample"] == 7
    study.run(copied, workers=1, resume=True)
    assert files_of(copied) == files_of(undisturbed)
