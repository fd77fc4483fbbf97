"""Registry of the attacks, and the loop that tries them in turn within a limited time."""

import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from time import monotonic


class FellShortError(Exception):
    """The cell, a client or a tool did not hold; with the observation."""


class NotPossibleError(Exception):
    """This computer does not allow the attack, e.g. without root; with the reason."""


@dataclass(frozen=True)
class Attack:
    """One way to disturb a cell: a function of (`World`, `Random`) that returns what it has tried."""

    kind: str
    name: str
    run: Callable
    share: int  # of the trials: an attack of share 3 is tried three times as often as one of share 1
    cases: tuple = ()  # third argument of `run`, each in turn in random order; none: `run` has two arguments


@dataclass
class Tally:
    """Outcomes of one attack."""

    held: int = 0
    skipped: str = ''
    failures: list = field(default_factory=list)  # (number of the trial, what was tried or seen)


ATTACKS: list[Attack] = []


def attack(kind, share=1, cases=()):
    """Register the decorated function as an attack of a `kind`; its name is the function's."""

    def register(function):
        ATTACKS.append(Attack(kind, function.__name__.replace('_', ' '), function, share, tuple(cases)))
        return function

    return register


def order(attacks, draw):
    """Yield attacks without end: every round has each as often as its share, in random order."""
    while True:
        rounds = [each for each in attacks for _ in range(each.share)]
        draw.shuffle(rounds)
        yield from rounds


def deck(attack, seed):
    """Yield the arguments of `attack` without end: all its cases in random order, then all again."""
    draw = Random(f'{seed} {attack.name}')
    while True:
        cases = [(case,) for case in attack.cases] or [()]
        draw.shuffle(cases)
        yield from cases


def campaign(attacks, seed, seconds, trials, world_of, tell):
    """
    Try `attacks` in turn until `seconds` [s, wall] are over or `trials` are done; return {attack: Tally}.

    Parameters
    ----------
    attacks : list of Attack
    seed : int
        Trial n of a seed draws the same random numbers each time.
    seconds, trials : float, int
        The trial that runs when the time is over is completed.
    world_of : callable
        ``world_of(number)`` returns the `World` of a trial, a context manager.
    tell : callable
        ``tell(number, attack, outcome)`` after each trial.

    """
    tallies = {each: Tally() for each in attacks}
    deadline, sequence = monotonic() + seconds, order(attacks, Random(seed))
    decks = {each: deck(each, seed) for each in attacks}
    for number in range(1, trials + 1):
        if monotonic() > deadline:
            break
        each = next(sequence)
        tally = tallies[each]
        if tally.skipped:
            continue
        try:
            with world_of(number) as world:
                outcome = 'held: ' + each.run(world, Random(f'{seed} {number}'), *next(decks[each]))
            tally.held += 1
        except NotPossibleError as reason:
            tally.skipped = outcome = f'not possible here: {reason}'
        except FellShortError as fault:
            outcome = f'fell short: {fault}'
            tally.failures.append((number, str(fault)))
        except Exception as error:  # a fault of the attack itself must not end the campaign, nor count as held
            fault = ''.join(traceback.format_exception_only(error)).strip()
            outcome = f'fell short: {fault}'
            tally.failures.append((number, fault))
        tell(number, each, outcome)
    return tallies
