"""Who may open the page, pair, and drive."""

from __future__ import annotations

import pytest

from host.panel.guard import (
    AWAY_S,
    CODE_S,
    GUESSES,
    PAIRED,
    WAIT_S,
    Pairing,
    Seat,
    own_host,
    own_origin,
)


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize(
    ("header", "address", "ours"),
    [
        ("127.0.0.1:8023", "127.0.0.1", True),
        ("localhost:8023", "127.0.0.1", True),
        ("[::1]:8023", "::1", True),
        ("192.168.1.7:8023", "192.168.1.7", True),
        ("localhost:8023", "192.168.1.7", False),
        ("evil.example:8023", "127.0.0.1", False),
        ("127.0.0.1.evil.example:8023", "127.0.0.1", False),
        ("127.0.0.1:80", "127.0.0.1", False),
        ("127.0.0.1", "127.0.0.1", False),
        ("192.168.1.8:8023", "192.168.1.7", False),
        ("user@127.0.0.1:8023", "127.0.0.1", False),
        ("127.0.0.1:8023/x", "127.0.0.1", False),
        ("127.0.0.1:99999", "127.0.0.1", False),
        ("", "127.0.0.1", False),
    ],
)
def test_only_the_address_that_was_reached_is_a_host(header: str, address: str, ours: bool) -> None:
    assert own_host(header, address, 8023) is ours


def test_only_the_own_page_is_an_origin() -> None:
    host = "127.0.0.1:8023"
    assert own_origin(f"http://{host}", host, needed=True)
    assert own_origin(None, host, needed=False)
    assert not own_origin(None, host, needed=True)
    for foreign in ("null", "http://evil.example", f"https://{host}", f"http://{host}.evil"):
        assert not own_origin(foreign, host, needed=False)


def test_a_code_pairs_once() -> None:
    pairing = Pairing(Clock(), needed=True)
    code = pairing.code
    ticket = pairing.pair(code.lower())
    assert ticket is not None
    assert pairing.known(ticket)
    assert pairing.pair(code) is None
    assert not pairing.known(None)
    assert not pairing.known(ticket + "x")


def test_a_code_grows_old() -> None:
    clock = Clock()
    pairing = Pairing(clock, needed=True)
    code = pairing.code
    clock.now += CODE_S + 1
    assert pairing.pair(code) is None
    assert pairing.code != code


def test_guesses_are_bounded_and_cost_ever_more_time() -> None:
    clock = Clock()
    pairing = Pairing(clock, needed=True)
    waits = []
    for _ in range(3):
        code = pairing.code
        for _ in range(GUESSES):
            assert pairing.pair("WRONG1") is None
        assert pairing.code != code
        assert pairing.pair(pairing.code) is None  # nobody pairs while it waits
        waits.append(pairing.wait_s)
        clock.now += pairing.wait_s + 0.1
    assert waits == pytest.approx([WAIT_S, 2 * WAIT_S, 4 * WAIT_S])
    assert pairing.pair(pairing.code) is not None


def test_so_many_phones_are_paired_at_most() -> None:
    pairing = Pairing(Clock(), needed=True)
    tickets = [pairing.pair(pairing.code) for _ in range(PAIRED + 1)]
    assert not pairing.known(tickets[0])
    assert all(pairing.known(ticket) for ticket in tickets[1:])


def test_without_the_network_nobody_pairs() -> None:
    assert Pairing(Clock(), needed=False).known(None)


def test_one_page_drives_until_it_leaves_or_falls_silent() -> None:
    clock = Clock()
    seat = Seat(clock)
    assert seat.take("a")
    assert not seat.take("b")
    assert not seat.hear("b")
    clock.now += AWAY_S - 0.1
    assert seat.hear("a")
    clock.now += AWAY_S - 0.1
    assert not seat.take("b")
    clock.now += 0.2
    assert seat.take("b")
    seat.leave("a")
    assert seat.holder == "b"
    seat.leave("b")
    assert seat.take("a")


def test_a_driver_that_sleeps_holds_the_seat_against_nobody() -> None:
    """Its socket may stay open for long: a phone that is locked, a link that is lost."""
    clock = Clock()
    seat = Seat(clock)
    assert not seat.taken
    seat.take("a")
    assert seat.taken
    clock.now += AWAY_S - 0.1
    assert seat.taken
    clock.now += 0.2
    assert not seat.taken
    assert seat.hear("a")
    assert seat.taken, "nobody has taken it meanwhile"
