"""No change that is not meant to has changed a number of any rollout; `golden` says how to look at one."""

import json
import random

import golden
import pytest

CHOSEN = list(golden.combinations())
KNOWN = json.loads(golden.HASHES.read_text())
OPEN_GROUND = [case for case in CHOSEN if case["id"] != "Rooms" and "fix" not in case]


def test_every_combination_has_a_hash():
    assert [golden.name_of(case) for case in CHOSEN] == list(KNOWN)
    assert len(KNOWN) >= 200


@pytest.mark.parametrize("chosen", random.Random(0).sample(CHOSEN, 40), ids=golden.name_of)
def test_a_rollout_in_plain_python_is_the_one_that_was_stored(chosen):
    assert golden.hash_of(chosen, "plain") == KNOWN[golden.name_of(chosen)]


@pytest.mark.parametrize("mode", ["scalar", "vector"])
@pytest.mark.parametrize("chosen", random.Random(1).sample(OPEN_GROUND, 3), ids=golden.name_of)
def test_a_compiled_rollout_is_the_one_that_was_stored(chosen, mode):
    assert golden.hash_of(chosen, mode) == KNOWN[golden.name_of(chosen)]
