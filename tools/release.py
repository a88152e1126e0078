"""Makes a signed release in a new folder: wheel, lock, bill of materials, SHA-256 sums, and a signature over these.

usage: python -m tools.release --key FILE --out FOLDER [--make-key]

The key is Ed25519 in PEM, readable by its owner only, and lies outside the checkout. Everybody can verify without this
project: `docs/releases.md`.
"""

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from distalock.version import revision
from shared.errors import ConfigurationError, DistalockError
from shared.pki.signing_key import SigningKey
from tools.npm_lock import console_lock
from tools.sbom import ROOT, bill_of_materials
from tools.wheel import built_wheel

SUMS: Final = "SHA256SUMS"
SIGNATURE: Final = "SHA256SUMS.sig"
PUBLIC_KEY: Final = "release.pub"
BILL: Final = "sbom.cdx.json"
LOCK: Final = "requirements.lock"
_UNCOMMITTED: Final = "+"


def main(arguments: Sequence[str] | None = None) -> int:
    """Make a release, or the key for it; 2 when that cannot be done."""
    given = _parser().parse_args(arguments)
    try:
        if given.make_key:
            _make_key(given.key)
        if given.out is not None:
            release(SigningKey.from_file(_outside(given.key)), given.out, made_at=_committed_at())
    except DistalockError as error:
        print(f"release: {error}", file=sys.stderr)
        return 2
    return 0


def release(key: SigningKey, out: Path, made_at: datetime) -> None:
    """Write a release into a new folder.

    Raises
    ------
    ConfigurationError
        When the folder is there already, or something of the checkout is not committed: a release is a revision.
    """
    changed = revision()
    if changed is None or changed.endswith(_UNCOMMITTED):
        raise ConfigurationError(f"the checkout is at {changed}: commit what was changed, then make the release")
    with tempfile.TemporaryDirectory() as folder:
        wheel = built_wheel(Path(folder), made_at)
        if (again := _sha256(built_wheel(_new(Path(folder) / "again"), made_at))) != _sha256(wheel):
            raise ConfigurationError(
                f"the wheel made again is another one ({_sha256(wheel)[:12]}, then {again[:12]}): nobody could check it"
            )
        files = [wheel, ROOT / LOCK]
        pyproject, lock = (ROOT / "pyproject.toml").read_text(), (ROOT / LOCK).read_text()
        bill = json.dumps(bill_of_materials(pyproject, lock, console_lock(), made_at), indent=1) + "\n"
        try:
            out.mkdir(parents=True)
        except OSError as error:
            raise ConfigurationError(f"{out} cannot be made ({error.strerror}); name a new folder") from None
        for file in files:
            shutil.copy(file, out)
        (out / BILL).write_text(bill, encoding="utf-8")
    sign(key, out)


def sign(key: SigningKey, folder: Path) -> None:
    """Write the sums of a folder's files, the signature over them and the key that verifies it."""
    sums = "".join(f"{_sha256(file)}  {file.name}\n" for file in sorted(folder.iterdir()))
    (folder / SUMS).write_text(sums, encoding="utf-8")
    (folder / SIGNATURE).write_bytes(bytes.fromhex(key.sign(sums.encode())))
    (folder / PUBLIC_KEY).write_bytes(key.public().pem)


def _new(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _make_key(file: Path) -> None:
    public = SigningKey.make(_outside(file)).public()
    print(f"{file}: SHA-256 of the public key is {public.sha256}; tell it where people can compare it")


def _outside(key: Path) -> Path:
    """A key in the checkout would be published with it one day."""
    if key.resolve().is_relative_to(ROOT):
        raise ConfigurationError(f"the key {key} lies in the checkout; keep it elsewhere, and name it with --key")
    return key


def _committed_at() -> datetime:
    words = ["git", "-C", str(ROOT), "log", "-1", "--format=%ct"]
    return datetime.fromtimestamp(int(subprocess.run(words, capture_output=True, text=True, check=True).stdout), UTC)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.release", description="make a signed release")
    parser.add_argument("--key", type=Path, required=True, help="release key, Ed25519 in PEM, outside the checkout")
    parser.add_argument("--make-key", action="store_true", help="make the key first")
    parser.add_argument("--out", type=Path, help="new folder for the release")
    return parser


if __name__ == "__main__":
    sys.exit(main())
