"""Tuned values of the robot service: tolerances, times, and what a plan is compared with."""

from dataclasses import dataclass

from services.robot.core.deviation import Deviation
from shared.tuning import derived, tuned


@dataclass(frozen=True, slots=True)
class Supervision:
    """How far the robot may be from where it must be, and how long it may take."""

    read_back: Deviation = tuned(
        Deviation(0.05, 0.05),
        "mm, °",
        "largest distance of a position that is read back from where the robot must be: on its target, locked, at the "
        "start of a plan",
        derived(
            "the hexapod's bound of 0.05 mm on a pose (`shared.geometry.hexapod_accuracy`), and the angle that "
            "moves a drill's end by as much over 60 mm"
        ),
    )
    path: Deviation = tuned(
        Deviation(0.5, 0.5),
        "mm, °",
        "largest distance from the straight path of a move",
        derived("half of the 1 mm within which motion must end after any failure"),
    )
    reference_travel: Deviation = tuned(
        Deviation(40.0, 60.0),
        "mm, °",
        "how far incremental encoders may move the platform for reference",
        derived(
            "the whole travel of the shipped hexapod, 39 mm and 33°, and more: reference may begin at one end of it"
        ),
    )
    reference_timeout_s: float = tuned(
        60.0, "s", "longest time of reference", derived("three times the 20 s of 40 mm at 2 mm/s")
    )
    duration_factor: float = tuned(
        1.5, "1", "longest time of a move, as a multiple of the planned one", derived("acceleration at both ends")
    )
    duration_margin_s: float = tuned(
        3.0,
        "s",
        "added to the longest time of a move",
        derived("eight questions of at most 0.25 s while it is unlocked, and `settle_s`"),
    )
    settle_s: float = tuned(
        1.0,
        "s",
        "longest time at rest before the controller reports its target reached",
        derived("fifty rounds of feedback, of which one is enough where nothing holds the robot"),
    )
    stop_confirmed_within_s: float = tuned(
        0.5,
        "s",
        "how long the answer to a stop waits for the controller to show standstill and brakes",
        derived("two reply time-outs of 0.25 s; half of the 1 s for which the gateway waits"),
    )
    oldest_feedback_s: float = tuned(
        0.5, "s", "age from which feedback no longer describes the robot", derived("five rounds of feedback at rest")
    )


@dataclass(frozen=True, slots=True)
class Rates:
    """How often the controller is asked, the state is published, and the gateway is checked."""

    poll_moving_s: float = tuned(
        0.02,
        "s",
        "pause between rounds of feedback in motion",
        derived("shorter than a round of eight questions, which takes 25 to 33 ms (docs/gcs.md)"),
    )
    poll_at_rest_s: float = tuned(
        0.1,
        "s",
        "pause between rounds of feedback at rest",
        derived("a fifth of the 0.5 s in which a slip must be seen"),
    )
    silence_at_rest_s: float = tuned(
        1.0,
        "s",
        "how long a controller that is slow may be asked again while the robot is locked at rest, where nothing is in "
        "danger",
        derived("four reply time-outs of 0.25 s"),
    )
    publish_moving_s: float = tuned(
        0.03, "s", "longest pause between two published states in motion", derived("one round of feedback")
    )
    publish_at_rest_s: float = tuned(
        0.1, "s", "longest pause between two published states at rest", derived("one round of feedback")
    )
    other_service_deadline_s: float = tuned(
        0.4,
        "s",
        "longest silence in motion of a service that was heard when it began (imaging, registration), and of "
        "`distalock up`",
        derived("eight signs of life at 20 Hz; 0.8 mm at 2 mm/s, and with the stop less than 0.5 s"),
    )
    gateway_check_s: float = tuned(
        0.02, "s", "pause between checks of the gateway's heartbeat", derived("a tenth of its deadline of 0.2 s")
    )


@dataclass(frozen=True, slots=True)
class PlanTolerances:
    """How exactly a plan must agree with what the robot service computes itself."""

    target: Deviation = tuned(
        Deviation(0.01, 0.01),
        "mm, °",
        "largest distance of a plan's target from where its own guide correction leads",
        derived("a fifth of what is tolerated when the position is read back"),
    )
    leg_length_mm: float = tuned(
        0.001, "mm", "largest difference of a plan's leg lengths from this robot's own", derived("a tenth of `target`")
    )
    pivot_mm: float = tuned(
        1e-6, "mm", "largest difference of a plan's pivot from the hexapod file's", derived("rounding of JSON numbers")
    )
    slowest_mm_per_s: float = tuned(
        0.01,
        "mm/s",
        "speed of a move that hardly shifts the pivot: a controller takes no speed of 0",
        derived("a two-hundredth of the usual 2 mm/s"),
    )


@dataclass(frozen=True, slots=True)
class ControllerLine:
    """The serial line to the controller."""

    reply_timeout_s: float = tuned(
        0.25, "s", "longest wait for an answer", derived("half of the 0.5 s in which motion must end after any failure")
    )
    write_timeout_s: float = tuned(
        0.1, "s", "longest wait for a line that takes no bytes", derived("a stop behind it still ends motion in 0.5 s")
    )
    stop_waits_for_writer_s: float = tuned(
        0.005,
        "s",
        "how long a stop waits for a command that is being written, before it is written regardless",
        derived("a hundredth of the 0.5 s; a command of 100 bytes takes 9 ms at 115,200 baud"),
    )
    lock_again_after_s: float = tuned(
        0.1,
        "s",
        "how long further stops are their stop byte alone after one that carried the whole lock",
        derived("six times the 17 ms that 196 bytes take at 115,200 baud; stops that come later send it again"),
    )
    read_attempts: int = tuned(
        3, "1", "how often a question is asked while its answers are garbled", derived("two disturbed answers in a row")
    )
    written_tolerance: float = tuned(
        1e-4,
        "mm, °",
        "largest difference of a target or pivot read back",
        derived("the fourth decimal that is printed"),
    )
    speed_tolerance_mm_per_s: float = tuned(
        1e-3, "mm/s", "largest difference of a speed read back", derived("a thousandth of the usual speeds")
    )


@dataclass(frozen=True, slots=True)
class Permits:
    """How long a permit to move can be used."""

    lifetime_s: float = tuned(
        2.0,
        "s",
        "longest time from the robot state that a permit quotes to its use, on the robot's clock",
        derived("the longest time to live of a command: no command outlives its permit by being asked for again"),
    )


@dataclass(frozen=True, slots=True)
class Guarding:
    """The guardian process, which stops the robot when this service cannot."""

    silence_s: float = tuned(
        0.2,
        "s",
        "longest silence of this service while the guardian is armed",
        derived("four signs of life; 0.4 mm at 2 mm/s, of the 1 mm within which motion must end after any failure"),
    )
    sign_of_life_s: float = tuned(
        0.05, "s", "longest pause between two signs of life in motion", derived("a quarter of `silence_s`")
    )
    answer_within_s: float = tuned(
        0.3,
        "s",
        "longest wait for an answer of the guardian, before a motion and in it",
        derived("with a round of feedback less than the 0.5 s in which motion must end after any failure"),
    )
    starts_within_s: float = tuned(
        10.0, "s", "longest time in which the guardian starts", derived("two hundred times what it takes, 0.05 s")
    )
    start_again_after_s: float = tuned(
        1.0, "s", "shortest time between two starts of the guardian", derived("as often as the controller is tried")
    )


SUPERVISION = Supervision()
RATES = Rates()
PLAN_TOLERANCES = PlanTolerances()
CONTROLLER_LINE = ControllerLine()
GUARDING = Guarding()
PERMITS = Permits()

SETTINGS = (SUPERVISION, RATES, PLAN_TOLERANCES, CONTROLLER_LINE, GUARDING, PERMITS)
