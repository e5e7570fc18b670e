"""Result codes are integers with names that NumPy and files keep."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod import Result


def test_codes_are_integers_with_names_and_sentences():
    assert [code.name for code in Result][:2] == ["ok", "collapsed"] and int(Result.ok) == 0
    assert all(Result[int(code)] == code.sentence and Result(int(code)) is code for code in Result)
    assert Result["ok"] is Result.ok and Result[Result.ok] == "the run reached its end"
    assert {code.name for code in Result} <= set(dir(Result))  # TAB


def test_a_sweep_goes_to_a_file_and_back(uniform, tmp_path):
    system = jaxrod.System(uniform, jaxrod.Rotation(), jaxrod.Ritz(0))

    def end(rate):
        sol = jaxrod.simulate(system, system.state(rate=rate), t1=0.1)
        return {"angle": sol.angle[-1], "result": sol.result}

    with pytest.warns(UserWarning, match="1 scenes did not end ok, 1 gave answers that are not finite"):
        out = jaxrod.sweep(end, jnp.array([1.0, jnp.inf, 3.0]))
    np.savez(tmp_path / "sweep.npz", **out)
    with np.load(tmp_path / "sweep.npz", allow_pickle=False) as back:
        np.testing.assert_array_equal(back["result"], out["result"])
        assert back["result"].dtype == np.int8 and Result[back["result"]][1] == Result.invalid.sentence
    assert Result[out["result"][0]] == "the run reached its end"
    table = np.rec.fromarrays(list(out.values()), names=list(out))  # rows as pandas makes them
    assert table[1].result == Result.invalid


@pytest.mark.parametrize("code", [77, -1, 0.5, None, [0, 77]])
def test_no_codes(code):
    with pytest.raises(ValueError, match=r"is no code; give one from 0 to \d+"):
        Result[code]


def test_a_sentence_needs_a_known_code():
    with pytest.raises(ValueError, match="outside of transformations"):
        jax.jit(lambda code: Result[code])(jnp.zeros((), jnp.int8))
    with pytest.raises(KeyError):
        Result["okay"]
