import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.analysis.log import is_complete, read_log
from airrace.common.errors import UserError
from airrace.recording import foxglove_messages
from airrace.recording.writer import RaceLog


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "race.mcap"
    log = RaceLog(path)
    for k in range(20):
        log.write("/explorer", float(k), foxglove_messages.log(float(k), "HOVER", "looking"))
        log.flush()
    log.close()
    return path


def test_all_of_it(log):
    assert is_complete(log)
    rows = list(read_log(log))
    assert [time for _, time, _ in rows] == list(range(20))
    assert rows[3][0] == "/explorer" and rows[3][2].name == "HOVER"
    assert list(read_log(log, ["/map"])) == []


@settings(max_examples=50)
@given(share=st.floats(0.0, 1.0))
def test_a_file_that_ends_anywhere_is_read_up_to_there(log, tmp_path_factory, share):
    whole = log.read_bytes()
    cut = tmp_path_factory.mktemp("cut") / "race.mcap"
    cut.write_bytes(whole[: max(8, int(share * len(whole)))])
    times = [time for _, time, _ in read_log(cut)]
    assert times == list(range(len(times)))
    assert len(times) >= 20 * share - 10  # the rest is the index
    assert is_complete(cut) == (share == 1.0)


@pytest.mark.parametrize(
    "content, words",
    [
        (None, "cannot be read .No such file.*--record light or full"),
        (b"", "is no MCAP file"),
        (b"PNG", "is no MCAP file"),
    ],
)
def test_what_is_no_log(tmp_path, content, words):
    if content is not None:
        (tmp_path / "race.mcap").write_bytes(content)
    with pytest.raises(UserError, match=words):
        list(read_log(tmp_path / "race.mcap"))
