"""Description of an archive: `ro-crate-metadata.json`, RO-Crate 1.1 (https://w3id.org/ro/crate/1.1).

The file is a flat list of JSON-LD entities: the metadata file, the data set with its authors and licence, and one
entity per file. Terms are from schema.org; ``sha256`` and ``kind`` are added to the context.
"""

import datetime as dt
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal
from urllib.parse import quote, unquote

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from solen.archive.contents import Contents, Item
from solen.errors import DataError, SpecError

NAME = "ro-crate-metadata.json"
CONTEXT = "https://w3id.org/ro/crate/1.1/context"
PROFILE = "https://w3id.org/ro/crate/1.1"
SOLEN_TERMS = "https://w3id.org/ro/terms/solen#"
LICENCES = {
    "CC0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/",
    "CC-BY-SA-4.0": "https://creativecommons.org/licenses/by-sa/4.0/",
    "CC-BY-NC-4.0": "https://creativecommons.org/licenses/by-nc/4.0/",
    "ODbL-1.0": "https://opendatacommons.org/licenses/odbl/1-0/",
    "MIT": "https://opensource.org/licenses/MIT",
}
"""Licence addresses, keyed by SPDX name; any other licence is specified by its address."""
SHA256 = r"^[0-9a-f]{64}$"
_ORCID = re.compile(r"(?:https://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dX])")


@dataclass(frozen=True)
class Author:
    """A person; ``orcid`` is empty if none is specified."""

    name: str
    orcid: str = ""

    @classmethod
    def of(cls, text: str) -> "Author":
        """Return the author in ``Name`` or ``Name <ORCID>``; raise `SpecError` if the identifier is invalid."""
        name, _, remainder = text.partition("<")
        identifier = remainder.rstrip(" >")
        match = _ORCID.fullmatch(identifier.strip())
        if not name.strip() or (identifier and not (match and _check_digit(match[1]))):
            limit, remedy = "must be a name, or a name with a valid ORCID", 'write "NAME" or "NAME <ORCID>"'
            raise SpecError("--author", value=text, limit=limit, remedy=remedy)
        return cls(name.strip(), match[1] if match else "")


def _check_digit(orcid: str) -> bool:
    """Return whether the last digit of an identifier is the check digit according to ISO 7064 mod 11-2."""
    total = 0
    for digit in orcid.replace("-", "")[:-1]:
        total = (total + int(digit)) * 2
    return orcid[-1] == "0123456789X"[(12 - total % 11) % 11]


def licence_of(text: str) -> str:
    """Return the address of a licence, given its SPDX name or address; raise `SpecError` if it is neither."""
    if text in LICENCES:
        return LICENCES[text]
    if re.fullmatch(r"https?://\S+", text):
        return text
    limit = f"must be {', '.join(LICENCES)}, or the address of another licence"
    raise SpecError("--licence", value=text, limit=limit)


def dumps(
    name: str, description: str, licence: str, authors: Sequence[Author], items: Sequence[Item], version: str
) -> str:
    """Return the text of the metadata file."""
    people = [
        {"@id": f"https://orcid.org/{author.orcid}" if author.orcid else f"#author-{i}"}
        for i, author in enumerate(authors)
    ]
    root = {
        "@id": "./", "@type": "Dataset", "name": name, "description": description,
        "datePublished": dt.datetime.now(dt.UTC).date().isoformat(), "license": {"@id": licence}, "author": people,
        "hasPart": [{"@id": quote(item.path)} for item in items],
    }  # fmt: skip
    entities: list[dict[str, Any]] = [
        {"@id": NAME, "@type": "CreativeWork", "about": {"@id": "./"}, "conformsTo": {"@id": PROFILE}},
        root,
        {"@id": licence, "@type": "CreativeWork", "name": licence_name(licence)},
        *({"@type": "Person", "name": author.name} | person for author, person in zip(authors, people, strict=True)),
        {"@id": "#solen", "@type": "SoftwareApplication", "name": "solen", "version": version},
        {"@id": "#packed", "@type": "CreateAction", "instrument": {"@id": "#solen"}, "result": {"@id": "./"}},
    ]
    for item in items:
        entities += _file(item)
    terms = {name: f"{SOLEN_TERMS}{name}" for name in ("kind", "simulated")}
    context = [CONTEXT, {"sha256": "http://schema.org/sha256"} | terms]
    return json.dumps({"@context": context, "@graph": entities}, indent=1, ensure_ascii=False) + "\n"


def _file(item: Item) -> Iterator[dict[str, Any]]:
    names = [f"#{item.path}/{quantity}" for quantity in item.quantities]
    yield {
        "@id": quote(item.path), "@type": "File", "name": item.path, "contentSize": item.size_bytes,
        "sha256": item.sha256, "encodingFormat": item.media_type, "kind": item.kind, "simulated": item.simulated,
        **({"variableMeasured": [{"@id": name} for name in names]} if names else {}),
    }  # fmt: skip
    for name, (quantity, unit) in zip(names, item.quantities.items(), strict=True):
        yield {"@id": name, "@type": "PropertyValue", "name": quantity} | ({"unitText": unit} if unit else {})


def licence_name(address: str) -> str:
    """Return the SPDX name of a licence, given its address, or the address if the name is unknown."""
    return next((name for name, licence_address in LICENCES.items() if licence_address == address), address)


class _Entity(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True, populate_by_name=True)


class _Reference(_Entity):
    id: str = Field(alias="@id")


class _File(_Entity):
    """Entity of a file, with the fields that are read."""

    type: Literal["File"] = Field(alias="@type")
    size_bytes: Annotated[int, Field(ge=0, alias="contentSize")]
    sha256: Annotated[str, Field(pattern=SHA256)]
    media_type: str = Field("application/octet-stream", alias="encodingFormat")
    kind: str = "other file"
    simulated: bool = False
    quantities: tuple[_Reference, ...] = Field((), alias="variableMeasured", strict=False)


class _Root(_Entity):
    name: str
    description: str = ""
    licence: _Reference = Field(alias="license")
    authors: tuple[_Reference, ...] = Field(alias="author", strict=False)
    parts: tuple[_Reference, ...] = Field(alias="hasPart", strict=False)


def loads(text: str, what: str) -> Contents:
    """Return the contents described by metadata; raise `DataError` unless they are RO-Crate metadata from `dumps`."""
    try:
        graph = json.loads(text)["@graph"]
        entities: Mapping[str, Any] = {entity["@id"]: entity for entity in graph}
        root = entities["./"]
    except (ValueError, KeyError, TypeError, RecursionError):
        limit, remedy = "is not RO-Crate metadata", "pack the files again with solen project pack"
        raise DataError(what, limit=limit, remedy=remedy) from None
    try:
        dataset = _Root.model_validate(root)
        files = [(unquote(part.id), _File.model_validate(entities.get(part.id, {}))) for part in dataset.parts]
    except ValidationError as bad:
        first = bad.errors()[0]
        key, limit = ".".join(map(str, first["loc"])), first["msg"].lower()
        raise DataError(f"{what}: {key}", limit=limit, remedy="pack the files again with solen project pack") from None
    people = [entities.get(author.id, {}).get("name", author.id) for author in dataset.authors]
    items = tuple(
        Item(
            path, file.kind, file.size_bytes, file.sha256, file.media_type,
            dict(_quantity(entities.get(ref.id, {})) for ref in file.quantities), file.simulated,
        )
        for path, file in files
    )  # fmt: skip
    return Contents(dataset.name, dataset.description, licence_name(dataset.licence.id), tuple(map(str, people)), items)


def _quantity(entity: Mapping[str, Any]) -> tuple[str, str]:
    return str(entity.get("name", "")), str(entity.get("unitText", ""))
