"""How frames came: by shared memory, or by TCP, which is slower and what happens where no memory can be shared."""

from dataclasses import dataclass

from shared.bus.port import Sample

# The first frame of a sender may come by TCP, while its memory is being mapped.
_MAPPED_AFTER = 1


@dataclass(slots=True)
class FramePaths:
    """Counts the frames of one subscription; called from its thread.

    Attributes
    ----------
    by_tcp_in_a_row
        How many of the newest frames came by TCP.
    """

    by_shared_memory: int = 0
    by_tcp: int = 0
    by_tcp_in_a_row: int = 0

    def note(self, sample: Sample) -> None:
        """Count a frame."""
        if sample.by_shared_memory:
            self.by_shared_memory += 1
            self.by_tcp_in_a_row = 0
        else:
            self.by_tcp += 1
            self.by_tcp_in_a_row += 1

    @property
    def fallen_back(self) -> bool:
        """Whether frames come by TCP although the sender's memory should long be mapped."""
        return self.by_tcp_in_a_row > _MAPPED_AFTER

    @property
    def sentence(self) -> str:
        """How many came by which way."""
        return f"frames by shared memory {self.by_shared_memory}, by TCP {self.by_tcp}"
