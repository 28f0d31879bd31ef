"""A bounded conversation with a language model through pydantic-ai.

Imported only when a model is asked: it takes a second.
"""

from __future__ import annotations

import asyncio
import inspect
import re
import warnings
from collections.abc import Sequence
from typing import Any

import httpx2
from openai import OpenAIError
from pydantic_ai import Agent, ModelRetry, NativeOutput, PromptedOutput, UsageLimits, capture_run_messages
from pydantic_ai.exceptions import (
    ModelAPIError,
    ModelHTTPError,
    ModelNotFoundError,
    UnexpectedModelBehavior,
    UnsupportedSettingWarning,
    UsageLimitExceeded,
    UsageLimitUnavailableWarning,
    UserError,
)
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models import Model, create_async_httpx2_client, infer_model
from pydantic_ai.models.openai import OpenAIChatModel
from pydantic_ai.profiles.openai import OpenAIModelProfile
from pydantic_ai.providers import Provider, infer_provider, infer_provider_class
from pydantic_ai.providers.openai_compatible import OpenAICompatibleProvider
from pydantic_ai.settings import ModelSettings

from bench.errors import LinkLost, RebarError, SetupError

from ._endpoint import COMPATIBLE, ModelEndpoint, is_on_this_machine
from ._model import MAX_ROUNDS, Conversation, Judge
from ._rewrite import Rewrite

OTHER_CLIENTS = ("cohere", "groq", "huggingface")
"""Providers whose packages want an HTTP client of another library, and so bring their own."""
MAX_TOKENS = 200_000
_NEEDED_HEADERS = {
    "host",
    "accept",
    "accept-encoding",
    "authorization",
    "connection",
    "content-length",
    "content-type",
    "user-agent",
}
# What pydantic-ai 2.68 raises for a completion whose `choices` are empty or no list: it indexes before it checks.
_MALFORMED = (LookupError, AttributeError, TypeError, ValueError)


def provider_of(model: str, url: str | None) -> str:
    """The provider named before the colon, when no `url` is given.

    Raises SetupError when the provider's package is missing.
    """
    name, colon, _ = model.partition(":")
    if url is not None or not colon:
        return COMPATIBLE
    try:
        infer_provider_class(name)
    # The colon belongs to the model's name, as in qwen3:8b.
    except ValueError:
        return COMPATIBLE
    except ImportError as error:
        extra = re.search(r"pydantic-ai-slim\[[a-z-]+\]", str(error))
        remedy = f".venv/bin/pip install '{extra[0]}'" if extra else str(error)
        raise SetupError("--llm", f"the package for {name} is not installed", remedy) from error
    return name


def converse(door: ModelEndpoint, brief: str, question: str, judge: Judge) -> Conversation:
    """Ask the model and send the judge's faults back to it. Raises as `ModelEndpoint.ask` does."""
    with warnings.catch_warnings():
        # That a model takes no temperature, or a server counts no tokens, is no concern of who asks.
        warnings.filterwarnings("ignore", message="Sampling parameters", category=UserWarning)
        warnings.simplefilter("ignore", UnsupportedSettingWarning)
        warnings.simplefilter("ignore", UsageLimitUnavailableWarning)
        return asyncio.run(_converse(door, brief, question, judge))


async def _converse(door: ModelEndpoint, brief: str, question: str, judge: Judge) -> Conversation:
    async with _open_client(door) as client:
        if door.provider == COMPATIBLE:
            hooks = [_strip_headers, *([] if door.key else [_strip_key])]
            client.event_hooks = {"request": [*client.event_hooks["request"], *hooks]}
        try:
            model = _model_for(door, client)
        except (UserError, OpenAIError, ImportError, ValueError) as error:
            raise SetupError("--llm", f"{door.model!r} cannot be asked", _advice(error)) from error
        for output in _outputs(model):
            with capture_run_messages() as messages:
                try:
                    return await _run(model, door, messages, (brief, question), judge, output)
                except _SchemaRefused:
                    continue
        raise LinkLost(f"{door.description} takes no request for a rewrite")


def _outputs(model: Model) -> list[NativeOutput[Rewrite] | PromptedOutput[Rewrite]]:
    """The ways to ask for JSON: by its schema where the server may take one, else by the prompt alone."""
    prompted = PromptedOutput(Rewrite)
    has_schema = model.profile.get("supports_json_schema_output", False)
    return [NativeOutput(Rewrite), prompted] if has_schema else [prompted]


class _SchemaRefused(Exception):
    """A server does not take the schema of an answer."""


def _open_client(door: ModelEndpoint) -> httpx2.AsyncClient:
    # A client that has a transport asks no proxy of the environment: none of them reaches a server on this machine.
    direct = door.provider == COMPATIBLE and is_on_this_machine(door.address)
    try:
        return create_async_httpx2_client(
            timeout=door.timeout_s, transport=httpx2.AsyncHTTPTransport() if direct else None
        )
    # A proxy of a kind that the client does not know, or knows with another package alone.
    except (ImportError, ValueError) as error:
        what = f"a proxy of the environment cannot be used: {_first_line(error)}"
        remedy = (
            "correct or unset HTTP_PROXY, HTTPS_PROXY and ALL_PROXY; for SOCKS, .venv/bin/pip install socksio"
        )
        raise SetupError("--llm", what, remedy) from error


async def _run(
    model: Model,
    door: ModelEndpoint,
    messages: list[ModelMessage],
    texts: tuple[str, str],
    judge: Judge,
    output: NativeOutput[Rewrite] | PromptedOutput[Rewrite],
) -> Conversation:
    # Output tools need a model trained for tools; a schema stands in the prompt as well, which every model understands.
    brief, question = texts
    agent = Agent(
        model,
        name="prose",
        output_type=output,
        instructions=brief,
        # A retry sends the judge's faults back, so the first answer and the retries together are the rounds.
        retries={"output": MAX_ROUNDS - 1, "tools": 0},
        model_settings=ModelSettings(
            temperature=0.0, timeout=door.timeout_s, request_timeout=door.timeout_s, max_retries=0
        ),
    )
    judged, judging = 0, False

    @agent.output_validator
    def judged_by(rewrite: Rewrite) -> Rewrite:
        nonlocal judged, judging
        judged, judging = len(_answers(messages)), True
        faults = judge(rewrite)
        judging = False
        if faults:
            # Sent back to the model.
            raise ModelRetry(faults)
        return rewrite

    try:
        await agent.run(
            question, usage_limits=UsageLimits(request_limit=MAX_ROUNDS, total_tokens_limit=MAX_TOKENS)
        )
    except UsageLimitExceeded:
        return Conversation(len(_answers(messages)), f"has used more than {MAX_TOKENS} tokens")
    except (ModelAPIError, UnexpectedModelBehavior) as error:
        answers = len(_answers(messages))
        if not answers and isinstance(output, NativeOutput) and _is_refusal(error):
            raise _SchemaRefused from error
        if type(error) is not UnexpectedModelBehavior or answers < MAX_ROUNDS:
            raise _failure(error, door) from error
    except _MALFORMED as error:
        if judging:
            raise
        raise LinkLost(
            f"{door.description} answers in another form than it should: {_first_line(error)}"
        ) from error
    return _ended(_answers(messages), judged)


def _is_refusal(error: Exception) -> bool:
    """Whether a server does not understand a request, as one without schemas does."""
    return isinstance(error, ModelHTTPError) and error.status_code in (400, 415, 422, 500, 501)


def _ended(answers: Sequence[ModelResponse], judged: int) -> Conversation:
    """A conversation that ended by itself, of which the judge has seen some answers."""
    broken = "its last answer is not the JSON object that was asked for"
    return Conversation(len(answers), "" if judged == len(answers) else broken)


def _failure(error: ModelAPIError | UnexpectedModelBehavior, door: ModelEndpoint) -> RebarError:
    """The error that tells a person why there is no answer."""
    if isinstance(error, ModelHTTPError):
        what = f"{door.description} answers {error.status_code}"
        if error.status_code in (401, 403):
            advice = "give its key in REBAR_LLM_KEY"
            remedy = (
                advice
                if door.provider == COMPATIBLE
                else f"check the key of {door.provider} in the environment"
            )
            return SetupError("--llm", f"{what}: it takes no such key", remedy)
        if isinstance(error, ModelNotFoundError):
            return SetupError("--llm", f"{what}: there is no {door.model!r}", "check the name and --llm-url")
        message = error.body.get("message") if isinstance(error.body, dict) else None
        return LinkLost(f"{what}: {str(message).splitlines()[0][:200]}" if message else what)
    if isinstance(error, ModelAPIError):
        return LinkLost(f"{door.description} does not answer: {_first_line(error)}")
    return LinkLost(f"{door.description} answers in another form than it should: {_first_line(error)}")


def _advice(error: Exception) -> str:
    """A library's message without its advice to programmers."""
    return re.sub(r" or pass it via `[^`]*`", "", str(error)).partition(" To try Pydantic AI")[0].rstrip(".")


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)[:200]


def _answers(messages: list[ModelMessage]) -> list[ModelResponse]:
    return [message for message in messages if isinstance(message, ModelResponse)]


def _model_for(door: ModelEndpoint, client: httpx2.AsyncClient) -> Model:
    if door.provider == COMPATIBLE:
        provider = OpenAICompatibleProvider(
            COMPATIBLE,
            base_url=door.address,
            api_key=door.key,
            http_client=client,
            profile=OpenAIModelProfile(
                supports_json_object_output=False,
                supports_json_schema_output=True,
                native_output_requires_schema_in_instructions=True,
            ),
        )
        return OpenAIChatModel(door.model, provider=provider)
    return infer_model(door.model, lambda name: _provider(name, client))


def _provider(name: str, client: httpx2.AsyncClient) -> Provider[Any]:
    # A gateway: the class of the provider behind it does not know the gateway's address.
    if "/" in name:
        return infer_provider(name)
    # Not every provider takes a client; those that do not keep their own.
    provider_class = infer_provider_class(name)
    takes_client = (
        name not in OTHER_CLIENTS and "http_client" in inspect.signature(provider_class.__init__).parameters
    )
    return provider_class(http_client=client) if takes_client else provider_class()  # type: ignore[call-arg]


async def _strip_headers(request: httpx2.Request) -> None:
    """Leave a compatible server the headers that it needs: the OpenAI client adds its version, the operating system and what
    the environment says of another provider.
    """
    for name in set(request.headers) - _NEEDED_HEADERS:
        del request.headers[name]


async def _strip_key(request: httpx2.Request) -> None:
    """Without a key the client sends a made-up one."""
    request.headers.pop("authorization", None)
