"""`manifest.json.sig`: an Ed25519 signature over the bytes of `manifest.json`, and the check of it.

The manifest holds the digest of every other file, so its signature is one of the whole folder.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import Field, ValidationError

from bench.documents import Document, dump_json, read_bytes
from bench.errors import Fault, SetupError, command_line

from ._file_system import check_file_system
from ._files import write_whole
from ._folder import SIGNATURE, CampaignFolder

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

_KEY_REMEDY = "give a key made by `ssh-keygen -t ed25519` or `openssl genpkey -algorithm ed25519`"


class ManifestSignature(Document):
    """The content of `manifest.json.sig`."""

    format: Literal["rebar.signature/1"] = "rebar.signature/1"
    algorithm: Literal["ed25519"] = "ed25519"
    public_key: str = Field(
        pattern="^ssh-ed25519 [A-Za-z0-9+/=]+$",
        description="The signer's key, as OpenSSH writes it, without a comment.",
    )
    signature: str = Field(description="64 bytes in base64, over the bytes of manifest.json.")


def sign_manifest(path: Path, key: Path, ask_passphrase: Callable[[], str]) -> str:
    """Write `manifest.json.sig` into a campaign folder, and return the fingerprint of the key.

    `key` is a private Ed25519 key in OpenSSH or PEM form; `ask_passphrase` is called if it is encrypted. Check
    the folder with `verify_folder` first. Raises SetupError without a manifest, without such a key, with a wrong
    passphrase, and where the package `cryptography` is not installed.
    """
    folder = CampaignFolder(path)
    if not folder.manifest.is_file():
        remedy = "only a complete campaign has a manifest: run the campaign to its end"
        raise SetupError(folder.manifest, "is missing, so there is nothing to sign", remedy)
    check_file_system(path, with_locks=False)
    private_key = _load_private_key(key, ask_passphrase)
    public_key = _public_text(private_key.public_key())
    signature = base64.b64encode(private_key.sign(folder.manifest.read_bytes())).decode()
    document = ManifestSignature(public_key=public_key, signature=signature)
    write_whole(folder.signature, dump_json(document))
    return fingerprint_of(public_key)


def signature_faults(path: Path, signed_by: Path | None = None) -> list[Fault]:
    """What is wrong with the signature of a campaign folder.

    Without `signed_by`, the file of a public key, it is compared with the key that it states itself, and a folder
    without a signature is no fault. Raises SetupError if `signed_by` is no public key, and if it is given where
    the package `cryptography` is not installed.
    """
    folder = CampaignFolder(path)
    expected = None if signed_by is None else _public_text(_load_public_key(signed_by))
    if not folder.signature.is_file():
        what, remedy = (
            "is missing: nobody has signed this manifest",
            f"run `{command_line('rebar', 'sign', path)} --key FILE`",
        )
        return [Fault(SIGNATURE, what, remedy)] if expected is not None else []
    document = read_signature(path)
    if document is None:
        return [Fault(SIGNATURE, "is damaged", "restore it from a copy, or sign again")]
    if expected not in (None, document.public_key):
        made, given = fingerprint_of(document.public_key), fingerprint_of(str(expected))
        remedy = "give the signer's public key; if you have it, somebody else signed this folder"
        return [Fault(SIGNATURE, f"was made with another key: {made}, and {signed_by} is {given}", remedy)]
    if not _fits(document, folder.manifest):
        what = f"does not fit {folder.manifest.name}: one of them was changed or written again after it was signed"
        return [Fault(SIGNATURE, what, "restore both from a copy, or let the signer sign again")]
    return []


def read_signature(path: Path) -> ManifestSignature | None:
    """The signature of a campaign folder; None if there is none, or a damaged one. It is not checked."""
    file = CampaignFolder(path).signature
    if not file.is_file():
        return None
    content = file.read_bytes()
    try:
        document = ManifestSignature.model_validate_json(content)
        # One spelling alone: otherwise a byte could change without a trace.
        same = dump_json(document).encode() == content and _respelled(document) == document
    except (ValidationError, binascii.Error, ValueError):
        return None
    return document if same else None


def fingerprint_of(public_key: str) -> str:
    """The fingerprint of a key in OpenSSH form, as `ssh-keygen -l` prints it."""
    blob = base64.b64decode(public_key.split()[1], validate=True)
    return "SHA256:" + base64.b64encode(hashlib.sha256(blob).digest()).decode().rstrip("=")


def _respelled(document: ManifestSignature) -> ManifestSignature:
    kind, blob = document.public_key.split(" ")
    texts = [
        base64.b64encode(base64.b64decode(text, validate=True)).decode()
        for text in (blob, document.signature)
    ]
    return document.model_copy(update={"public_key": f"{kind} {texts[0]}", "signature": texts[1]})


def _fits(document: ManifestSignature, manifest: Path) -> bool:
    if not can_check_signatures():
        # With `signed_by`, its loading has refused this already. Without, nobody asked for the signature.
        return True
    from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_ssh_public_key

    try:
        key = load_ssh_public_key(document.public_key.encode())
        if not isinstance(key, Ed25519PublicKey) or not manifest.is_file():
            return False
        key.verify(base64.b64decode(document.signature), manifest.read_bytes())
    except (InvalidSignature, UnsupportedAlgorithm, ValueError):
        return False
    return True


def _load_private_key(path: Path, ask_passphrase: Callable[[], str]) -> Ed25519PrivateKey:
    _need_cryptography()
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_ssh_private_key

    data = read_bytes(path)
    load = load_ssh_private_key if b"OPENSSH PRIVATE KEY" in data else load_pem_private_key
    try:
        try:
            key = load(data, None)
        except TypeError:
            # This is how the library says that the key is encrypted.
            key = load(data, ask_passphrase().encode())
    except Exception as error:  # of several kinds: the file is anybody's
        what = f"cannot be read as a private key, or the passphrase is wrong: {error}"
        raise SetupError(path, what, _KEY_REMEDY) from error
    if not isinstance(key, Ed25519PrivateKey):
        raise SetupError(path, "is a private key of another kind than Ed25519", _KEY_REMEDY)
    return key


def _load_public_key(path: Path) -> Ed25519PublicKey:
    _need_cryptography()
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key, load_ssh_public_key

    data = read_bytes(path)
    if b"PRIVATE KEY" in data:
        remedy = "give the public key: the file that ends in .pub, or what `openssl pkey -pubout` writes"
        raise SetupError(path, "is a private key", remedy)
    try:
        key = load_pem_public_key(data) if data.startswith(b"-----") else load_ssh_public_key(data)
    except Exception as error:  # of several kinds: the file is anybody's
        raise SetupError(path, f"cannot be read as a public key: {error}", _KEY_REMEDY) from error
    if not isinstance(key, Ed25519PublicKey):
        raise SetupError(path, "is a public key of another kind than Ed25519", _KEY_REMEDY)
    return key


def _public_text(key: Ed25519PublicKey) -> str:
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    text: bytes = key.public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH)
    return text.decode()


def can_check_signatures() -> bool:
    """Whether the package `cryptography` is installed."""
    return find_spec("cryptography") is not None


def _need_cryptography() -> None:
    if not can_check_signatures():
        remedy = "install it with `pip install 'rebar-bench[sign]'`"
        raise SetupError("", "signatures need the package cryptography", remedy)
