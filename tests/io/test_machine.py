"""Free memory as the kernel and the control group tell it."""

from swarm_mj.io.machine import available_bytes

MEMINFO = "MemTotal:       16000000 kB\nMemFree:         1000000 kB\nMemAvailable:    8000000 kB\n"


def test_the_smaller_of_machine_and_control_group_counts(tmp_path):
    meminfo, group = tmp_path / "meminfo", tmp_path / "group"
    meminfo.write_text(MEMINFO)
    group.mkdir()
    assert available_bytes(meminfo, group) == 8_000_000 * 1024
    (group / "memory.max").write_text("max\n")
    (group / "memory.current").write_text("5\n")
    assert available_bytes(meminfo, group) == 8_000_000 * 1024
    (group / "memory.max").write_text("1000\n")
    assert available_bytes(meminfo, group) == 995
    (group / "memory.current").write_text("2000\n")
    assert available_bytes(meminfo, group) == 0


def test_a_system_that_does_not_tell_is_none(tmp_path):
    assert available_bytes(tmp_path / "none", tmp_path / "nothing") is None
