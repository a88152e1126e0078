"""Traces after W3C's recommendation: what counts as a header, and how a trace travels between threads."""

import threading

import pytest

from shared.tracing import carried, current_traceparent, new_trace_id, trace_id_of, traced

TRACE = "0af7651916cd43dd8448eb211c80319c"


@pytest.mark.parametrize(
    ("header", "trace_id"),
    [
        (f"00-{TRACE}-b7ad6b7169203331-01", TRACE),
        (f"00-{TRACE}-b7ad6b7169203331-00", TRACE),
        (f"cc-{TRACE}-b7ad6b7169203331-01-what-the-future-brings", TRACE),
        (f"00-{TRACE}-b7ad6b7169203331-01-more", None),
        (f"ff-{TRACE}-b7ad6b7169203331-01", None),
        (f"00-{32 * '0'}-b7ad6b7169203331-01", None),
        (f"00-{TRACE}-{16 * '0'}-01", None),
        (f"00-{TRACE.upper()}-b7ad6b7169203331-01", None),
        (f"00-{TRACE}-b7ad6b7169203331-01\n", None),
        ("", None),
    ],
)
def test_what_names_a_trace(header: str, trace_id: str | None) -> None:
    assert trace_id_of(header) == trace_id


def test_a_header_names_the_trace_and_a_span_of_its_own() -> None:
    assert current_traceparent() is None
    with traced(TRACE):
        one, other = current_traceparent(), current_traceparent()
        assert one is not None
        assert other is not None
        assert trace_id_of(one) == trace_id_of(other) == TRACE
        assert one != other
    assert current_traceparent() is None
    assert trace_id_of(f"00-{new_trace_id()}-b7ad6b7169203331-01") is not None


def test_a_thread_works_for_the_trace_that_handed_it_its_work() -> None:
    seen: list[str | None] = []

    def work() -> None:
        seen.append(current_traceparent())

    with traced(TRACE):
        threads = [threading.Thread(target=carried(work)), threading.Thread(target=work)]
    for thread in threads:
        thread.start()
        thread.join()
    assert [header and trace_id_of(header) for header in seen] == [TRACE, None]
