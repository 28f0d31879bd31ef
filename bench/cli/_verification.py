"""Commands about what a campaign's folder proves: verify, sign."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.errors import SetupError

from ._missing_runs import INCOMPLETE_EXIT_CODE

if TYPE_CHECKING:
    from bench.campaign import ReflownSample


def verify(
    folder: Annotated[Path, typer.Argument(help="Folder of a campaign")],
    digest: Annotated[
        str | None,
        typer.Option(help="SHA-256 of the manifest as `rebar run` printed it and you published it"),
    ] = None,
    signed_by: Annotated[
        Path | None,
        typer.Option(
            "--signed-by",
            metavar="KEY",
            help="Public key (OpenSSH or PEM) that must have signed the manifest",
        ),
    ] = None,
    refly: Annotated[
        int | None,
        typer.Option(
            "--refly",
            min=1,
            metavar="N",
            help="Fly N drawn lockstep runs again and compare them, bit for bit but for real autopilots",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed that draws the runs of --refly. Default: a new one")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Sessions at once for --refly. Default: the number of cores")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Check every file of a campaign against its manifest, its chain of evidence and its journal.

    Ends with code 1 if something differs, and with code 3 if runs of --refly could not be compared.

    Example: rebar verify out/demo --refly 5
    """
    if refly is None and (seed is not None or workers is not None):
        raise SetupError(
            "--seed" if seed is not None else "--workers", "is for --refly alone", "give --refly N too"
        )
    from bench.campaign import CampaignFolder, digest_of, load_campaign, question_sha256, verify_folder

    paths = CampaignFolder(folder)
    faults = [str(fault) for fault in verify_folder(folder, digest, signed_by)]
    manifest = digest_of(paths.manifest) if paths.manifest.is_file() else None
    # Of a folder that was changed it would say nothing.
    question = None if faults else question_sha256(load_campaign(paths.campaign))
    if not as_json:
        _print_check(folder, faults, manifest, question, signed_by)
    # A repetition of what is not what was flown would prove nothing.
    sample = None if refly is None or faults else _reflown(folder, refly, seed, workers, as_json=as_json)
    if as_json:
        document = {
            "folder": str(folder),
            "manifest_sha256": manifest,
            "faults": faults,
            "question_sha256": question,
            "refly": sample and asdict(sample),
        }
        print(json.dumps(document))
    if faults:
        raise typer.Exit(1)
    if sample is not None:
        _exit_for(sample)


def sign(
    folder: Annotated[Path, typer.Argument(help="Folder of a complete campaign")],
    key: Annotated[
        Path,
        typer.Option(metavar="KEY", help="Private Ed25519 key of ssh-keygen or openssl (OpenSSH or PEM)"),
    ],
) -> None:
    """Check a campaign as `rebar verify` does, and sign its manifest, which stands for every file.

    Example: rebar sign out/demo --key ~/.ssh/id_ed25519
    """
    from bench.campaign import CampaignFolder, digest_of, sign_manifest, verify_folder

    paths = CampaignFolder(folder)
    # An earlier signature is about to be replaced, so whether it fits is of no interest.
    faults = [fault for fault in verify_folder(folder) if fault.where != paths.signature.name]
    if faults:
        raise SetupError(faults)
    signer = sign_manifest(folder, key, lambda: str(typer.prompt("passphrase", hide_input=True, err=True)))
    print(f"manifest SHA-256: {digest_of(paths.manifest)}")
    print(f"signed with the key {signer}: {paths.signature}")


def _print_check(
    folder: Path, faults: Sequence[str], manifest: str | None, question: str | None, signed_by: Path | None
) -> None:
    """The faults of a folder; without any what it proves: the digests of its manifest, and of its situations and design."""
    from bench.campaign import CampaignFolder, can_check_signatures, fingerprint_of, read_signature

    if faults:
        print("\n".join(faults))
        return
    has_chain = CampaignFolder(folder).evidence.is_file()
    chain = "the chain of evidence" if has_chain else "(there is no chain of evidence)"
    if manifest is None:
        print(f"{folder}: all results match {chain} and the journal; there is no manifest yet")
    else:
        print(f"{folder}: all files match the manifest, {chain} and the journal")
        print(f"manifest SHA-256: {manifest}")
    if (signature := read_signature(folder)) is not None:
        signer = fingerprint_of(signature.public_key)
        whose = f"that of {signed_by}" if signed_by else "--signed-by KEY checks whose it is"
        if not can_check_signatures():
            whose = "not checked: pip install 'rebar-bench[sign]'"
        print(f"signed with the key {signer} ({whose})")
    print(f"situations and design: {question}")


def _reflown(
    folder: Path, count: int, seed: int | None, workers: int | None, *, as_json: bool
) -> ReflownSample:
    from bench.campaign import refly

    # A seed that nobody knew while the campaign flew: otherwise the runs that nobody would repeat could be known.
    drawn_seed = secrets.randbelow(2**32) if seed is None else seed
    sample = refly(folder, count, drawn_seed, workers or len(os.sched_getaffinity(0)))
    if not as_json:
        print(f"flown again, drawn with --seed {drawn_seed}: {len(sample.runs)} of {sample.comparable} runs")
        for run in sample.runs:
            print(f"{run.realization}: {run.status}" + (f": {run.explanation}" if run.explanation else ""))
        for reason, names in sample.not_comparable.items():
            more = f" and {len(names) - 5} more; --json lists all" if len(names) > 5 else ""
            print(f"not comparable, {reason}: {len(names)} runs ({', '.join(names[:5])}{more})")
    return sample


def _exit_for(sample: ReflownSample) -> None:
    """Raises typer.Exit if a run differs, or if one or all could not be compared."""
    from bench.campaign import ReflownStatus

    statuses = {run.status for run in sample.runs}
    if ReflownStatus.DIFFERENT in statuses:
        raise typer.Exit(1)
    if not statuses or statuses - {ReflownStatus.IDENTICAL, ReflownStatus.EQUAL}:
        raise typer.Exit(INCOMPLETE_EXIT_CODE)
