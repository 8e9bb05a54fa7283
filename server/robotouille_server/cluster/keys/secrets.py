"""Signing keys, revoked tokens and used tokens that all nodes share.

Each node keeps its key file and its list of revoked tokens equal to the cluster's. So
`robotouille-token` works on the files of any node's machine, and the server reads its files as it
does without a cluster.
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_server.auth import keys as key_files
from robotouille_server.auth.keys import KEPT_KEYS, FileKeyring, Key, KeyFileError
from robotouille_server.auth.private_files import Fingerprint, PrivateFileError, fingerprint
from robotouille_server.auth.revocation import (
    TokenUse,
    add_revoked,
    check_revoked_count,
    encode_revoked,
    load_revoked,
    merge_revoked,
    not_recorded,
    parse_revoked,
)
from robotouille_server.cluster.bus import Bucket, Bus, BusError, ConflictError, Entry
from robotouille_server.cluster.keys.sealing import Seal, read_cluster_key
from robotouille_server.cluster.keys.used_tokens import USED, SharedUses
from robotouille_server.runtime.logs import get_logger

__all__ = ["SharedSecrets", "keys_digest", "read_cluster_key"]

KEYS, REVOKED = "keys", "revoked"
MAX_VALUE_BYTES = 1_000_000
"""NATS refuses messages above 1 MiB, unless it is configured otherwise."""
ATTEMPTS = 5
"""Attempts to change a value that other nodes change at the same time."""


class SharedSecrets:
    """Secrets of a node that are the same on all nodes.

    Args:
        bus: The connection to the other nodes.
        key_file: The node's key file, or None if the operator provides the keys of each node.
        revoked_file: The node's list of revoked tokens.
        key: The key that encrypts the signing keys in the bucket.
        wall: Returns the time in seconds since 1970.
    """

    def __init__(
        self,
        bus: Bus,
        key_file: Path | None,
        revoked_file: Path,
        key: bytes | None = None,
        wall: Callable[[], float] = time.time,
    ) -> None:
        self._bus = bus
        self._keys = _SharedKeys(bus, key_file, Seal(key)) if key_file is not None else None
        self._revoked = _SharedRevocations(bus, revoked_file, wall)
        self._used = SharedUses(bus, wall)

    async def join(self) -> None:
        """Write the cluster's secrets into the node's files, before the server reads them.

        Raises:
            RobotouilleError: The files or the cluster's keys cannot be used.
            BusError: The cluster cannot be reached.
        """
        if self._keys is not None:
            await self._keys.join()
        self._revoked.prepare()
        await self._watch()
        await self.share_changes()

    async def _watch(self) -> set[str]:
        """Watch the bucket; return the names of the values in it."""
        found, complete = set[str](), False

        def changed(name: str, entry: Entry | None) -> None:
            if not complete:
                found.add(name)
            self._changed(name, entry)

        await self._bus.watch(Bucket.SHARED, changed)
        complete = True
        return found

    async def restore(self) -> None:
        """Store what this node knows again, if an operator has deleted the bucket.

        Raises:
            BusError: The cluster cannot be reached.
        """
        # In a new bucket, revisions begin again.
        self._changed(KEYS, None)
        self._changed(REVOKED, None)
        await self._used.restore(await self._watch())
        await self.share_changes()

    async def share_changes(self) -> None:
        """Share what `robotouille-token` has changed in the node's files.

        Call this function about once a second. Without changes it costs one `stat` for each file.

        Raises:
            BusError: The cluster cannot be reached. The next call tries again.
        """
        if self._keys is not None:
            await self._keys.share()
        await self._revoked.share()
        await self._used.forget_outdated()

    def digest(self) -> str:
        """Return a digest of the node's keys; empty if the operator provides them."""
        return keys_digest(self._keys.keys) if self._keys is not None else ""

    def _changed(self, name: str, entry: Entry | None) -> None:
        if name == KEYS and self._keys is not None:
            self._keys.changed(entry)
        elif name == REVOKED:
            self._revoked.changed(entry)
        elif name.startswith(USED):
            self._used.changed(name, entry)

    # Tokens for one session

    def check_unused(self, token_id: str, session: str = "") -> None:
        """Raise ProtocolError `auth/used` if this node has learned of another session's use."""
        self._used.check(token_id, session)

    async def use(self, token_id: str, session: str, expires: float) -> bool:
        """Use up a token for one session.

        Returns:
            False if the session has used it before.

        Raises:
            ProtocolError: `auth/used` if another session has used the token, `server/recording` if
                its use cannot be recorded.
        """
        try:
            return await self._used.use(token_id, TokenUse(session=session, expires=expires))
        except BusError as error:
            raise not_recorded(error) from None

    async def release(self, token_id: str, session: str) -> None:
        """Make a token unused again, because its session could not join.

        If the cluster cannot be reached, the token stays usable for this session only.
        """
        with suppress(BusError, ProtocolError):
            await self._used.release(token_id, session)


def keys_digest(keys: Iterable[Key]) -> str:
    """Return a digest that differs between nodes with different keys, as 16 hex digits.

    Names alone would not do: operators give different secrets the same name.
    """
    parts = sorted(
        key.kid.encode() + hmac.digest(key.secret, b"robotouille key digest", hashlib.sha256)
        for key in keys
    )
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def merged_keys(
    own: tuple[Key, ...], base: tuple[Key, ...], shared: tuple[Key, ...]
) -> tuple[Key, ...]:
    """Return the cluster's keys with the changes of one node.

    Args:
        own: The node's keys.
        base: The node's keys before it changed them.
        shared: The cluster's keys, which another node may have changed since.
    """
    if shared == base:
        return own
    new = [key for key in own if key not in base and key not in shared]
    # A key that was dropped on purpose must not come back.
    gone = {key.kid for key in (*base, *new)} - {key.kid for key in own if key not in new}
    rest = [key for key in shared if key.kid not in gone]
    most = max(KEPT_KEYS, len(own), len(shared))
    return tuple([*new, *rest][:most]) or own


class _Value:
    """Value in the bucket, with the latest revision that this node has seen."""

    def __init__(self, bus: Bus, name: str) -> None:
        self.name = name
        self.revision = 0
        self._bus = bus
        self.problem = ""

    async def read(self) -> Entry | None:
        entry = await self._bus.get(Bucket.SHARED, self.name)
        if entry is None:
            self.revision = 0
        return entry

    async def write(self, value: bytes) -> bool:
        """Replace the latest revision; return whether this is the latest one now.

        Raises:
            ConflictError: There is a later revision.
        """
        if self.revision:
            revision = await self._bus.update(Bucket.SHARED, self.name, value, self.revision)
        else:
            revision = await self._bus.create(Bucket.SHARED, self.name, value)
        return self.note(revision)

    def note(self, revision: int) -> bool:
        """Note a revision; return False if it is outdated."""
        latest = revision >= self.revision
        self.revision = max(revision, self.revision)
        return latest

    def report(self, event: str, error: Exception | str) -> None:
        """Log an error, but not every second."""
        if str(error) != self.problem:
            self.problem = str(error)
            get_logger().error(event, error=self.problem)


def _check_size(value: bytes, name: str) -> None:
    if len(value) > MAX_VALUE_BYTES:
        raise RobotouilleError(f"the cluster's value {name!r} has {len(value)} bytes")


class _SharedKeys:
    """Keeps a key file equal to the cluster's keys.

    Attributes:
        keys: The keys of the file at the last comparison with the cluster's. If the file has other
            keys, `robotouille-token rotate` has changed it since.
    """

    def __init__(self, bus: Bus, path: Path, seal: Seal) -> None:
        self.keys: tuple[Key, ...] = ()
        self._value = _Value(bus, KEYS)
        self._path = path
        self._seal = seal
        self._shared: tuple[Key, ...] = ()
        self._seen: Fingerprint | None = None
        self._readable = True
        self._sharing = False

    async def join(self) -> None:
        key_files.make_key_folder(self._path)
        for _ in range(ATTEMPTS):
            entry = await self._value.read()
            if entry is not None:
                self._shared = self._opened(entry.value)
                self._value.note(entry.revision)
                self._adopt()
                return
            own = FileKeyring(self._path).keys
            # Of two nodes that start at the same time, one is first.
            with suppress(ConflictError):
                await self._value.write(self._closed(own))
                self.keys = self._shared = own
                return
        raise ConflictError("the nodes cannot agree on signing keys; start this node again")

    def _adopt(self) -> None:
        """Replace the node's own keys by the cluster's."""
        self.keys = key_files.load(self._path) if self._path.exists() else ()
        if lost := [key.kid for key in self.keys if key not in self._shared]:
            get_logger().warning(
                "the cluster's signing keys replace keys of this machine; tokens signed with those "
                "are invalid. Run `robotouille-token rotate` only while the node runs",
                file=str(self._path),
                replaced=lost,
            )
        if key_files.replace_keys(self._path, self._shared, self.keys):
            self.keys = self._shared

    def changed(self, entry: Entry | None) -> None:
        """Note a change of the bucket, and change the file."""
        if entry is None:
            # Another node or an operator has deleted the keys. `share` stores them again.
            self._value.revision = 0
            self._readable = True
        elif entry.revision > self._value.revision and self._read(entry) and not self._sharing:
            self._update_file()

    def _read(self, entry: Entry) -> bool:
        """Read the cluster's keys; return whether they can be used."""
        self._value.note(entry.revision)
        try:
            self._shared = self._opened(entry.value)
        except RobotouilleError as error:
            # Overwriting them would start a fight with the node that has stored them.
            self._value.report("invalid keys of the cluster ignored", error)
            self._readable = False
        else:
            self._value.problem = ""
            self._readable = True
        return self._readable

    def _update_file(self) -> bool:
        try:
            # If the file was changed, too, `share` merges both changes.
            if key_files.replace_keys(self._path, self._shared, self.keys):
                self.keys = self._shared
        except KeyFileError as error:
            self._value.report("the cluster's keys not written", error)
            return False
        return True

    async def share(self) -> None:
        seen = fingerprint(self._path)
        settled = self._value.revision > 0 and self.keys == self._shared
        if (settled and seen == self._seen) or not self._readable:
            return
        try:
            own = key_files.load(self._path)
        except KeyFileError as error:
            self._value.report("invalid keys not shared with the cluster", error)
            if (seen is None or not settled) and not self._update_file():
                return
        else:
            if not await self._share(own):
                return
            self._value.problem = ""
        self._seen = seen

    async def _share(self, own: tuple[Key, ...]) -> bool:
        """Bring changes of the file to the bucket, then those of the bucket to the file."""
        # Until then, the file must not be replaced.
        self._sharing = True
        try:
            if not await self._share_file(own):
                return False
        finally:
            self._sharing = False
        self.keys = own
        return self._update_file()

    async def _share_file(self, own: tuple[Key, ...]) -> bool:
        for _ in range(ATTEMPTS):
            known = self._value.revision > 0
            wanted = merged_keys(own, self.keys, self._shared) if known else own
            if known and wanted == self._shared:
                return True
            try:
                if await self._value.write(self._closed(wanted)):
                    self._shared = wanted
                names = [key.kid for key in wanted]
                get_logger().info("signing keys shared with the cluster", keys=names)
                return True
            except ConflictError:
                entry = await self._value.read()
                if entry is not None and not self._read(entry):
                    return False
        return False

    def _opened(self, value: bytes) -> tuple[Key, ...]:
        _check_size(value, KEYS)
        return key_files.parse_keys(self._seal.open(KEYS, value), "the cluster's signing keys")

    def _closed(self, keys: tuple[Key, ...]) -> bytes:
        return self._seal.close(KEYS, key_files.encode_keys(keys))


class _SharedRevocations:
    """Keeps a list of revoked tokens equal to the cluster's. Entries are only added."""

    def __init__(self, bus: Bus, path: Path, wall: Callable[[], float]) -> None:
        self._value = _Value(bus, REVOKED)
        self._path = path
        self._wall = wall
        self._shared: dict[str, float] = {}
        self._seen: Fingerprint | None = None
        self._settled = False

    def prepare(self) -> None:
        """Create the folder of the file."""
        key_files.make_key_folder(self._path)

    def changed(self, entry: Entry | None) -> None:
        """Note a change of the bucket, and add the new entries to the file."""
        if entry is None:
            self._value.revision = 0
            self._shared = {}
        elif entry.revision > self._value.revision:
            self._read(entry)
            self._update_file()
        # Entries may be missing in the bucket now.
        self._settled = False

    def _read(self, entry: Entry) -> None:
        self._value.note(entry.revision)
        try:
            _check_size(entry.value, REVOKED)
            shared = parse_revoked(entry.value, "the cluster's revoked tokens")
            check_revoked_count(shared, "the cluster's revoked tokens")
        except RobotouilleError as error:
            # The next revocation replaces the value. The nodes add what they know.
            self._value.report("invalid list of the cluster ignored", error)
            shared = {}
        self._shared = shared

    def _update_file(self) -> bool:
        try:
            if self._shared:
                add_revoked(self._path, self._shared, self._wall())
        except PrivateFileError as error:
            self._value.report("the cluster's revoked tokens not written", error)
            return False
        return True

    async def share(self) -> None:
        seen = fingerprint(self._path)
        if self._settled and seen == self._seen:
            return
        # A change during the calls below unsettles it again.
        self._settled = True
        try:
            own = load_revoked(self._path)
            done = await self._share(own) and self._update_file()
        except PrivateFileError as error:
            # Nothing helps until the file or the bucket changes.
            self._value.report("revoked tokens not shared with the cluster", error)
        except BusError:
            self._settled = False
            raise
        else:
            self._settled = self._settled and done
            self._value.problem = "" if done else self._value.problem
        self._seen = seen

    async def _share(self, own: dict[str, float]) -> bool:
        """Add entries to the bucket; return whether it has all of them now."""
        for _ in range(ATTEMPTS):
            now = self._wall()
            wanted = merge_revoked(self._shared, own, now)
            if wanted == merge_revoked(self._shared, {}, now):
                return True
            check_revoked_count(wanted, str(self._path))
            # Without spaces, as many entries as allowed fit into a message of NATS.
            value = encode_revoked(wanted, indent=None)
            if len(value) > MAX_VALUE_BYTES:
                fault = f"more than {MAX_VALUE_BYTES} bytes for the cluster; rotate the keys"
                raise PrivateFileError(str(self._path), fault)
            try:
                if await self._value.write(value):
                    self._shared = wanted
                get_logger().info("revoked tokens shared with the cluster", count=len(wanted))
                return True
            except ConflictError:
                entry = await self._value.read()
                if entry is None:
                    self._shared = {}
                else:
                    self._read(entry)
        return False
