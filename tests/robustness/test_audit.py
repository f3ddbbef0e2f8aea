"""`make audit` runs pip-audit where an advisory service can be reached, and says so where none can."""

import shutil
import subprocess
from pathlib import Path

import pytest

pytestmark = [pytest.mark.robust, pytest.mark.skipif(shutil.which("sh") is None, reason="there is no shell")]

ROOT = Path(__file__).parents[2]


def audit(tmp_path, *, reachable=(), installed=True, findings=0, installs=True):
    """Run the script with programs that only say how they were called; `reachable` are parts of addresses that answer."""
    answers = " ".join(f"*{part}*) exit 0 ;;" for part in reachable)
    program(tmp_path / "python", f"""
        if [ "$1" = -c ]; then case "$3" in {answers} *) exit 1 ;; esac; fi
        echo "python $*"
        {f'cp {tmp_path}/spare {tmp_path}/pip-audit' if installs else 'exit 1'}
    """)  # fmt: skip
    program(tmp_path / "spare", f'echo "pip-audit $*"; exit {findings}')
    if installed:
        shutil.copy(tmp_path / "spare", tmp_path / "pip-audit")
    done = subprocess.run(["sh", str(ROOT / "scripts" / "audit.sh"), str(tmp_path)], capture_output=True, text=True)
    return done.returncode, done.stdout


def program(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


@pytest.mark.parametrize(("reachable", "service"), [(("pypi.org", "osv.dev"), "pypi"), (("osv.dev",), "osv")])
def test_where_a_service_answers_pip_audit_asks_it(tmp_path, reachable, service):
    status, said = audit(tmp_path, reachable=reachable)
    assert status == 0
    assert said == f"pip-audit --local --skip-editable --vulnerability-service {service}\n"


def test_vulnerabilities_are_an_error(tmp_path):
    assert audit(tmp_path, reachable=["pypi.org"], findings=1)[0] == 1


def test_where_no_service_answers_it_says_that_nothing_was_checked(tmp_path):
    status, said = audit(tmp_path)
    assert status == 2
    assert "No advisory service can be reached" in said and "nothing was checked" in said
    assert "pip-audit --local" not in said


def test_pip_audit_is_installed_where_it_is_missing_or_it_is_said_that_it_cannot_be(tmp_path):
    status, said = audit(tmp_path, reachable=["pypi.org"], installed=False)
    assert status == 0
    assert said.startswith("python -m pip install") and "\npip-audit --local" in said
    (tmp_path / "pip-audit").unlink()
    status, said = audit(tmp_path, reachable=["pypi.org"], installed=False, installs=False)
    assert status == 2 and "cannot be installed: nothing was checked" in said


def test_the_target_stands_in_makefile_and_on_the_page_as_its_generator_writes_it():
    assert "\naudit: setup-dev ## " in (ROOT / "Makefile").read_text()
    page = (ROOT / "docs" / "results" / "dependencies.md").read_text("utf-8")
    assert "`make audit`" in page
    generator = pytest.importorskip("scripts.pages.dependencies")
    assert page.startswith(generator.INTRODUCTION)
