"""Tests of pages may be skipped without a browser, unless the environment says that it is required."""

import pytest

from tests.browser import Watchdog, chromium


def test_a_required_browser_that_is_absent_fails(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("OBJECTFOLDER_BROWSER", "required")
    with pytest.raises(pytest.fail.Exception, match="no chromium"):
        chromium()
    monkeypatch.delenv("OBJECTFOLDER_BROWSER")
    with pytest.raises(pytest.skip.Exception, match="no chromium"):
        chromium()


def test_a_browser_that_is_there_is_found(monkeypatch, tmp_path):
    executable = tmp_path / "chromium"
    executable.write_text("")
    executable.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert chromium() == str(executable)


def test_a_wait_for_what_does_not_happen_ends(browser):
    page = browser.new_page()
    page.set_default_timeout(0)
    with Watchdog(patience_s=0.5) as watchdog, pytest.raises(Exception, match="closed"):
        page.wait_for_selector("#never")
    assert watchdog.ended
