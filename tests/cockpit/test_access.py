"""Access to the cockpit."""

from __future__ import annotations

import pytest

from bicycle_cockpit.access import AccessPolicy, RefusedError

TOKEN = "0123456789abcdef"


@pytest.mark.parametrize("address", ["127.0.0.1", "localhost", "::1", "127.0.0.2"])
def test_this_machine_needs_no_token(address: str) -> None:
    AccessPolicy(address).check_token("")


@pytest.mark.parametrize("address", ["0.0.0.0", "::", "192.168.1.5", "bicycle.local"])
def test_others_need_one(address: str) -> None:
    with pytest.raises(ValueError, match="--token auto"):
        AccessPolicy(address)
    door = AccessPolicy(address, TOKEN)
    door.check_token(TOKEN)
    for wrong in ("", TOKEN[:-1], TOKEN.upper()):
        with pytest.raises(RefusedError, match="missing or wrong") as caught:
            door.check_token(wrong)
        assert caught.value.status == 401
        assert TOKEN not in str(caught.value)


@pytest.mark.parametrize("token", ["short", "with a space in it", "0123456789abcde/"])
def test_a_weak_token_is_refused(token: str) -> None:
    with pytest.raises(ValueError, match="letters and digits"):
        AccessPolicy("0.0.0.0", token)


@pytest.mark.parametrize("host", ["127.0.0.1:8765", "localhost:8765", "[::1]:8765", "localhost"])
def test_a_local_server_by_its_names(host: str) -> None:
    AccessPolicy().check_host(host)


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "192.168.1.5:8765", "", "[::1", "a@b:c"]
)
def test_a_local_server_by_any_other_name(host: str) -> None:
    with pytest.raises(RefusedError, match="is not this server"):
        AccessPolicy().check_host(host)


def test_an_open_server_by_number_or_by_the_names_it_was_given() -> None:
    door = AccessPolicy("0.0.0.0", TOKEN, frozenset(("bicycle.lan",)))
    for host in ("192.168.1.5:8765", "[fe80::1]:80", "Bicycle.lan:8765", "localhost:8765"):
        door.check_host(host)
    with pytest.raises(RefusedError):
        door.check_host("evil.example:8765")


@pytest.mark.parametrize(
    ("address", "host"),
    [
        ("127.0.0.2", "127.0.0.2:8765"),
        ("bicycle.local", "bicycle.local:8765"),
        ("Bicycle.Local", "bicycle.local"),
        ("192.168.1.5", "192.168.1.5:8765"),
        ("fe80::1", "[fe80::1]:8765"),
    ],
)
def test_a_server_by_the_address_that_it_is_bound_to(address: str, host: str) -> None:
    """The printed address holds it."""
    door = AccessPolicy(address, TOKEN)
    door.check_host(host)
    with pytest.raises(RefusedError):
        door.check_host("evil.example:8765")


@pytest.mark.parametrize("name", ["http://bicycle.lan/", "bicycle.lan:8765", "a@b", "a b", "[::1"])
def test_a_name_that_no_browser_sends_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"--host-name .* alone"):
        AccessPolicy("0.0.0.0", TOKEN, frozenset((name,)))


@pytest.mark.parametrize("site", ["cross-site", "same-site", "strange"])
def test_another_site_may_lead_here_and_ask_for_nothing(site: str) -> None:
    door = AccessPolicy()
    door.check_site(site, "navigate", "/")
    for mode, path in (("no-cors", "/"), ("navigate", "/bags/x"), (None, "/"), ("cors", "/bags")):
        with pytest.raises(RefusedError, match="another site"):
            door.check_site(site, mode, path)


@pytest.mark.parametrize("site", [None, "same-origin", "none"])
def test_its_own_pages_and_other_programs_may_ask(site: str | None) -> None:
    AccessPolicy().check_site(site, "cors", "/bags")


def test_only_its_own_pages_open_a_websocket() -> None:
    door, host = AccessPolicy(), "127.0.0.1:8765"
    door.check_origin("http://127.0.0.1:8765", host)
    for origin in (
        None,
        "null",
        "http://evil.example",
        "http://127.0.0.1:9999",
        "http://127.0.0.1:8765.evil.example",
        "file://",
    ):
        with pytest.raises(RefusedError, match="foreign"):
            door.check_origin(origin, host)
