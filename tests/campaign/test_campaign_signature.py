"""A signed manifest: keys of both forms, each way to be wrong, and an independent check."""

from __future__ import annotations

import base64
import json
import random
import shutil
import subprocess
from pathlib import Path
from unittest.mock import Mock

import pytest
from campaign_fakes import fly, known

from bench.campaign import fingerprint_of, read_signature, sign_manifest, verify_folder
from bench.cli._app import run
from bench.errors import SetupError

pytest.importorskip("cryptography", reason="the extra [sign] is not installed")
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

FORMS = {
    "openssh": (PrivateFormat.OpenSSH, Encoding.OpenSSH, PublicFormat.OpenSSH),
    "pem": (PrivateFormat.PKCS8, Encoding.PEM, PublicFormat.SubjectPublicKeyInfo),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A campaign of made sessions, its question included, so that `rebar verify` reads all of it."""
    fly(tmp_path / "out")
    return tmp_path / "out"


def sign(folder: Path, key: Path, code: int = 0) -> None:
    assert run(["sign", str(folder), "--key", str(key)]) == code


def fault_of(folder: Path, signed_by: Path | None = None) -> str:
    """The only fault, which lies in the signature."""
    (fault,) = verify_folder(folder, signed_by=signed_by)
    assert fault.where == "manifest.json.sig"
    return fault.what


def key_pair(home: Path, form: str, seed: int, passphrase: str = "") -> tuple[Path, Path]:
    """A private and a public key file."""
    key = Ed25519PrivateKey.from_private_bytes(random.Random(seed).randbytes(32))
    private, encoding, public = FORMS[form]
    encryption = BestAvailableEncryption(passphrase.encode()) if passphrase else NoEncryption()
    paths = home / f"key-{form}-{seed}", home / f"key-{form}-{seed}.pub"
    paths[0].write_bytes(key.private_bytes(Encoding.PEM, private, encryption))
    paths[1].write_bytes(key.public_key().public_bytes(encoding, public))
    return paths


@pytest.mark.parametrize("form", sorted(FORMS))
def test_the_signer_is_told_from_anybody_else(
    folder: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both forms of keys fit each other; another key is named with both fingerprints."""
    private, public = key_pair(folder.parent, form, 1)
    _, same = key_pair(folder.parent, "pem" if form == "openssh" else "openssh", 1)
    _, other = key_pair(folder.parent, form, 2)
    sign(folder, private)
    signature = known(read_signature(folder))
    signer = fingerprint_of(signature.public_key)
    assert f"signed with the key {signer}" in capsys.readouterr().out
    for signed_by in (None, public, same):
        assert verify_folder(folder, signed_by=signed_by) == []
    assert run(["verify", str(folder), "--signed-by", str(public)]) == 0
    assert f"signed with the key {signer} (that of {public})" in capsys.readouterr().out

    words = f"was made with another key: {signer}, and {other} is SHA256:"
    assert fault_of(folder, other).startswith(words)
    assert run(["verify", str(folder), "--signed-by", str(other)]) == 1


def test_no_signature_and_a_manifest_written_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder without one passes unless one is asked for; one that does not fit is never passed over."""
    private, public = key_pair(folder.parent, "openssh", 1)
    assert verify_folder(folder) == []
    assert fault_of(folder, public).startswith("is missing: nobody has signed this manifest")

    sign(folder, private)
    next(folder.glob("runs/*/result.json")).unlink()
    fly(folder)
    for signed_by in (None, public):
        assert fault_of(folder, signed_by).startswith("does not fit manifest.json")
    sign(folder, private)
    assert verify_folder(folder, signed_by=public) == []

    # What does not verify is not signed.
    capsys.readouterr()
    (folder / "campaign.yaml").write_text("edited")
    (folder / "manifest.json.sig").unlink()
    sign(folder, private, 2)
    assert "campaign.yaml" in capsys.readouterr().err
    assert not (folder / "manifest.json.sig").exists()


def test_a_flipped_byte_of_the_signature_is_found(folder: Path) -> None:
    """At every fifth position, whatever else is equal to it as JSON or as base64."""
    private, public = key_pair(folder.parent, "pem", 1)
    sign(folder, private)
    file = folder / "manifest.json.sig"
    content, draw = file.read_bytes(), random.Random(4)
    for position in {*range(0, len(content), 5), *range(len(content) - 8, len(content))}:
        flipped = bytearray(content)
        flipped[position] ^= 1 << draw.randrange(7)
        file.write_bytes(flipped)
        for signed_by in (None, public):
            assert fault_of(folder, signed_by)


def test_keys_that_are_none_are_refused_with_the_remedy(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Missing, noise, of another kind, public in place of private and the other way round."""
    private, public = key_pair(folder.parent, "openssh", 1)
    noise, curve = folder.parent / "noise", folder.parent / "curve"
    noise.write_bytes(b"-----BEGIN PRIVATE KEY-----\nnoise\n")
    curve.write_bytes(
        generate_private_key(SECP256R1()).private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    )
    for key, text in (
        (folder.parent / "gone", "there is no such file"),
        (noise, "cannot be read as a private key"),
        (public, "cannot be read as a private key"),
        (curve, "is a private key of another kind than Ed25519"),
    ):
        sign(folder, key, 2)
        assert f"rebar: {key}: {text}" in capsys.readouterr().err
    assert run(["verify", str(folder), "--signed-by", str(private)]) == 2
    assert f"rebar: {private}: is a private key (give the public key" in capsys.readouterr().err


@pytest.mark.parametrize("form", sorted(FORMS))
def test_an_encrypted_key_asks_for_its_passphrase(folder: Path, form: str) -> None:
    """Once, and the wrong one is a sentence; a key that is not encrypted asks for none."""
    private, public = key_pair(folder.parent, form, 3, "open sesame")
    ask = Mock(side_effect=["open barley", "open sesame"])
    with pytest.raises(SetupError, match="the passphrase is wrong"):
        sign_manifest(folder, private, ask)
    sign_manifest(folder, private, ask)
    assert verify_folder(folder, signed_by=public) == []
    sign_manifest(folder, key_pair(folder.parent, form, 4)[0], ask)
    assert ask.call_count == 2


@pytest.mark.parametrize("form", ["ssh-keygen", "openssl"])
def test_keys_of_the_usual_programs_and_the_check_of_openssl(folder: Path, tmp_path: Path, form: str) -> None:
    """Keys as users make them, and the signature checked without REBAR, as the docs say."""
    if not (shutil.which("ssh-keygen") and shutil.which("openssl")):
        pytest.skip("ssh-keygen or openssl is not installed")
    private, public, raw = tmp_path / "key", tmp_path / "key.pub", tmp_path / "raw"
    if form == "ssh-keygen":
        command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "a comment", "-f", str(private)]
        subprocess.run(command, check=True)
    else:
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", str(private)], check=True)
        subprocess.run(["openssl", "pkey", "-in", str(private), "-pubout", "-out", str(public)], check=True)
    sign(folder, private)
    assert verify_folder(folder, signed_by=public) == []
    if form == "ssh-keygen":
        listed = subprocess.run(["ssh-keygen", "-lf", public], check=True, capture_output=True, text=True)
        signature = known(read_signature(folder))
        assert fingerprint_of(signature.public_key) in listed.stdout
        return
    raw.write_bytes(base64.b64decode(json.loads((folder / "manifest.json.sig").read_text())["signature"]))
    check = ["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", str(public), "-rawin"]
    check += ["-in", str(folder / "manifest.json"), "-sigfile", str(raw)]
    assert subprocess.run(check, capture_output=True, check=False).returncode == 0
