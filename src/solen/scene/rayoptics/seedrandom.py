"""The random numbers of ray-optics for a seed: the seedrandom generator, which is RC4 without its first 256 bytes.

With these numbers, a random beam has the same rays in both programs. Each number has 52 random bits, as in David Bau's
seedrandom 3.
"""

from collections.abc import Iterator

WIDTH = 256
MASK = WIDTH - 1
SIGNIFICANCE = 2.0**52
OVERFLOW = 2.0**53


def random_numbers(seed: str) -> Iterator[float]:
    """Yield an unlimited sequence of numbers in [0, 1)."""
    stream = _bytes(_key(seed))
    for _ in range(WIDTH):
        next(stream)
    while True:
        numerator, denominator, last = 0.0, 1.0, 0
        for _ in range(6):
            numerator, denominator = numerator * WIDTH + next(stream), denominator * WIDTH
        while numerator < SIGNIFICANCE:
            numerator, denominator = (numerator + last) * WIDTH, denominator * WIDTH
            last = next(stream)
        while numerator >= OVERFLOW:
            numerator, denominator, last = numerator / 2.0, denominator / 2.0, last >> 1
        yield (numerator + last) / denominator


def _key(seed: str) -> list[int]:
    """Return the key, at most 256 numbers into which the characters of the seed are mixed."""
    key: list[int] = []
    smear = 0
    for j, letter in enumerate(seed):
        index = j & MASK
        smear ^= (key[index] if index < len(key) else 0) * 19
        value = MASK & (smear + ord(letter))
        if index < len(key):
            key[index] = value
        else:
            key.append(value)
    return key or [0]


def _bytes(key: list[int]) -> Iterator[int]:
    state = list(range(WIDTH))
    j = 0
    for i in range(WIDTH):
        j = MASK & (j + key[i % len(key)] + state[i])
        state[i], state[j] = state[j], state[i]
    i = j = 0
    while True:
        i = MASK & (i + 1)
        j = MASK & (j + state[i])
        state[i], state[j] = state[j], state[i]
        yield state[MASK & (state[i] + state[j])]
