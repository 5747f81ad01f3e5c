"""Who may release plans: a file of names and public keys; and signatures, which are checked offline.

Without it everybody may and nothing is signed. It is ``roster.json`` beside the tables or ``UPPLIED_ROSTER``.
"""

import json
import os
import unicodedata
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from upplied.catalog.schema.rows import Row, json_text
from upplied.catalog.store.files import FileStore
from upplied.errors import CatalogError, InputError, RefusedError, SettingsError, UppliedError
from upplied.extras import extra
from upplied.files import replace_file

_LONGEST = 200  # letters of a name
_LONGEST_TEXT = 2000  # letters of a class, a severity or a note
_TURNS = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}  # direction of writing
_MOST_BYTES = 1 << 20
#: Of a decision, what is signed.
_SIGNED = ("decision_id", "transfer_id", "demonstration_id", "target_id", "purpose", "state", "by", "note",
           "forced", "plan_sha256", "plan_row_sha256", "target_sha256", "supposed_sha256",
           "after")  # fmt: skip
#: Scripts that one name may mix.
_TOGETHER = ({"HIRAGANA", "KATAKANA", "KATAKANA-HIRAGANA", "CJK"}, {"HANGUL", "CJK"}, {"BOPOMOFO", "CJK"})
#: Letters of Cyrillic and Greek by the Latin one that they look like.
_LIKE = str.maketrans(
    "\u0430\u044c\u0441\u0501\u0435\u04bb\u0456\u0458\u043a\u04cf\u043c\u043f\u043e\u0440\u0433\u0455\u0442\u0438"
    "\u0475\u0445\u0443\u03b1\u03b5\u03b9\u03ba\u03bf\u03c1\u03c4\u03c5\u03bd\u03c7",
    "abcdehijklmnoprstuvxyaeikoptuvx",
)


@dataclass(frozen=True)
class Person:
    """Somebody who may release, or once might."""

    name: str
    key: str  # public, Ed25519, 64 hexadecimal digits
    until: str = ""  # the last decision that counts, of one who may no longer; empty: who may


class Roster:
    """Who may release plans of the catalog at a location."""

    def __init__(self, location: str) -> None:
        elsewhere = os.environ.get("UPPLIED_ROSTER")
        folder, self._name = os.path.split(elsewhere or f"{location.rstrip('/')}/roster.json")
        self._files = FileStore(folder or ".")
        self.path = self._files.path(self._name)
        self.people = self._read(required=bool(elsewhere))  # everybody; None where there is no roster

    def _read(self, required: bool) -> list[Person] | None:
        try:
            if not self._files.has(self._name):
                if required:
                    raise OSError("there is no such file")
                return None
            place = Path(self.path)
            if self._files.local and (not place.is_file() or place.stat().st_size > _MOST_BYTES):
                raise OSError("it is no file, or too large")
            people = [Person(**one) for one in json.loads(self._files.read(self._name))["people"]]
            for one in people:
                if not all(isinstance(value, str) for value in vars(one).values()):
                    raise ValueError("its people are not texts")
                bytes.fromhex(one.key)
                check_name(one.name)
        except (OSError, ValueError, KeyError, TypeError, RecursionError, UppliedError) as error:
            remedy = "take it from a backup; until then nothing is released"
            raise CatalogError(self.path, f"is no roster: {error}", "who may release", remedy) from None
        return people

    def active(self) -> list[Person]:
        """Those who may release now."""
        return [one for one in self.people or [] if not one.until]

    def add(self, name: str, key: str) -> None:
        """Let somebody release."""
        check_name(name)
        if len(key) != 64 or any(digit not in "0123456789abcdef" for digit in key):
            rule, remedy = "64 hexadecimal digits", "see: upplied keys new"
            raise InputError(f"key of {name}", f"is {key[:80]!r}", rule, remedy)
        for one in self.people or []:
            if _skeleton(one.name) == _skeleton(name) or one.key == key:
                rule = "every name and key is another, and none looks like another"
                raise InputError(f"roster name {name!r}", f"is that of {one.name!r}, or looks like it", rule)
        self._write([*(self.people or []), Person(name, key)])

    def retire(self, name: str, last_decision: str) -> None:
        """Let somebody release no longer; what they released until now stays so."""
        if name not in {one.name for one in self.active()}:
            raise InputError(f"roster name {name!r}", "is of nobody who may release", self.path)
        last = last_decision or "none"
        self._write([Person(one.name, one.key, one.until or (last if one.name == name else ""))
                     for one in self.people or []])  # fmt: skip

    def _write(self, people: list[Person]) -> None:
        document = {"format": "upplied roster", "people": [asdict(one) for one in people]}
        self._files.write(self._name, (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode())
        self.people = people

    def check_may_release(self, by: str) -> None:
        """Refuse whoever is not on the roster, where there is one."""
        if self.people is not None and by not in {one.name for one in self.active()}:
            listed = ", ".join(one.name for one in self.active()) or "nobody"
            raise RefusedError(f"release by {by!r}", "is not on the roster", f"who may release: {listed}")

    def fault(self, decision: Row, order: dict[str, int]) -> str:
        """Why a release does not count, in words; `order` is the number of each decision's commit."""
        if self.people is None:
            return ""
        person = next((one for one in self.people if one.name == decision["by"]), None)
        if person is None:
            return f"{decision['by']} is not on the roster"
        if person.until and order[decision["decision_id"]] > order.get(person.until, -1):
            return f"{person.name} may no longer release"
        return "" if _verifies(person.key, decision) else f"it is not signed by {person.name}"


def author(by: str, what: str) -> str:
    """The name of whoever says, decides or finds something; nobody, or a misleading name, is refused."""
    if not by.strip():
        raise SettingsError(what, "has nobody who says so", "a name", "say --by NAME")
    return check_name(by.strip())


def check_name(name: str) -> str:
    """A person's name; one that could be taken for another, or hides something, is refused."""
    what, remedy = f"name {ascii(name)[:100]}", "write it in letters of one script, composed (NFKC)"
    if not name.strip() or name != name.strip() or len(name) > _LONGEST:
        fault = "is empty, too long, or begins or ends with a space"
        raise SettingsError(what, fault, f"1 to {_LONGEST} letters")
    if unicodedata.normalize("NFKC", name) != name:
        raise SettingsError(what, "has letters that are written otherwise than they look", "", remedy)
    scripts = {unicodedata.name(letter, "").split(" ")[0] for letter in name if letter.isalpha()}
    unseen = "CZM" if scripts & {"LATIN", "CYRILLIC", "GREEK"} or not scripts else "CZ"
    if hidden := [each for each in name if unicodedata.category(each)[0] in unseen and each != " "]:
        raise SettingsError(what, f"has {hidden[0]!a}, which nobody sees", "letters, digits, signs", remedy)
    if len(scripts) > 1 and not any(scripts <= mixed for mixed in _TOGETHER):
        raise SettingsError(what, f"mixes {', '.join(sorted(scripts)).lower()} letters", "one script", remedy)
    return name


def check_text(what: str, name: str, text: str) -> None:
    """Refuse a text that is too long, has control letters or turns the direction of writing."""
    if len(text) > _LONGEST_TEXT:
        raise SettingsError(what, f"its {name} is longer", f"at most {_LONGEST_TEXT} letters")
    for letter in text:
        turns = unicodedata.bidirectional(letter) in _TURNS
        if turns or (unicodedata.category(letter) in ("Cc", "Cs") and letter not in "\n\t"):
            remedy = "write it in letters, digits and signs"
            raise SettingsError(what, f"its {name} has {letter!a}, which nobody sees", "", remedy)


def _skeleton(name: str) -> str:
    plain = unicodedata.normalize("NFKD", name.casefold()).translate(_LIKE)
    plain = plain.replace("0", "o").replace("1", "l").replace("i", "l").replace("rn", "m")
    return "".join(letter for letter in plain if letter.isalnum())


def _signing() -> tuple[Any, Any, type[Exception]]:
    with extra("signing"):
        from cryptography.exceptions import InvalidSignature
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    return serialization, ed25519, InvalidSignature


def key_path(name: str) -> Path:
    """Where the private key of somebody lies: in ``UPPLIED_KEYS``, or among the user's settings."""
    usual = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "upplied" / "keys"
    return Path(os.environ.get("UPPLIED_KEYS") or usual) / f"{quote(check_name(name), safe='')}.pem"


def new_key(name: str) -> str:
    """Make somebody's key pair; the public key. ``UPPLIED_KEY_PASSPHRASE`` encrypts the private one."""
    path = key_path(name)
    if path.exists():
        raise InputError(str(path), "is there already", "one key for a name", "move it away to make another")
    serialization, ed25519, _ = _signing()
    key = ed25519.Ed25519PrivateKey.generate()
    phrase = os.environ.get("UPPLIED_KEY_PASSPHRASE", "").encode()
    locked = serialization.BestAvailableEncryption(phrase) if phrase else serialization.NoEncryption()
    content = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, locked)
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    path.touch(mode=0o600, exist_ok=False)
    replace_file(path, content, private=True)
    return str(key.public_key().public_bytes_raw().hex())


def signature(roster: Roster, decision: Row) -> str:
    """The signature of a decision, empty without roster or key; an unsigned release is refused."""
    person = next((one for one in roster.active() if one.name == decision["by"]), None)
    path = key_path(decision["by"]) if person is not None else Path()
    if person is None or not path.is_file():
        if roster.people is not None and decision["state"] == "released":
            remedy = "sign where the key lies (UPPLIED_KEYS); a new one: upplied keys new NAME"
            what = f"release by {decision['by']!r}"
            raise RefusedError(what, f"there is no key at {path}", "signed", remedy)
        return ""
    serialization, phrase = _signing()[0], os.environ.get("UPPLIED_KEY_PASSPHRASE", "").encode() or None
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), phrase)
    except (ValueError, TypeError, OSError) as error:
        remedy = "set UPPLIED_KEY_PASSPHRASE where it is encrypted"
        raise InputError(str(path), f"cannot be read: {error}", "a private key, PEM", remedy) from None
    if key.public_key().public_bytes_raw().hex() != person.key:
        remedy = "sign with the key whose public half is there"
        raise RefusedError(str(path), "is another key than the roster's", roster.path, remedy)
    return str(key.sign(_text(decision)).hex())


def _verifies(key: str, decision: Row) -> bool:
    _, ed25519, invalid = _signing()
    try:
        public = ed25519.Ed25519PublicKey.from_public_bytes(bytes.fromhex(key))
        public.verify(bytes.fromhex(decision["signature"] or ""), _text(decision))
    except (invalid, ValueError):
        return False
    return True


def _text(decision: Row) -> bytes:
    return json_text({name: decision.get(name) or "" for name in _SIGNED}).encode()
