"""The columns of a campaign's results, and rows as an Arrow table.

`row`, `run`, `scenario`, `seed`; the drawn parameters by dotted key; `status`, `error`, `covered`, `spacecraft`; what is
recorded; `events`; and last `wall_s`, the only column that differs when a run is flown again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pyarrow as pa

from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.distributions import Bernoulli, Choice, Integer
from swarm_mj.campaigns.outcome import recorded

#: The column that is not the same when a run is flown again.
WALL = "wall_s"


def schema_of(campaign: Campaign) -> pa.Schema:
    """Names and types of the columns."""
    fields = [("row", pa.int64()), ("run", pa.int64()), ("scenario", pa.string()), ("seed", pa.int64())]
    fields += [(key, _type_of(law)) for key, law in campaign.parameters.items()]
    fields += [("status", pa.string()), ("error", pa.string()), ("covered", pa.bool_()), ("spacecraft", pa.int64())]
    fields += [(column, pa.float64()) for column in recorded(campaign)]
    fields += [("events", pa.string()), (WALL, pa.float64())]
    return pa.schema(fields)


def table_of(rows: Sequence[dict[str, Any]], schema: pa.Schema) -> pa.Table:
    """Rows as a table; what a row lacks is null."""
    columns = [pa.array([_cell(row.get(f.name), f.type) for row in rows], f.type) for f in schema]
    return pa.Table.from_arrays(columns, schema=schema)


def _type_of(law: Any) -> pa.DataType:
    if isinstance(law, Bernoulli):
        return pa.bool_()
    if isinstance(law, Integer):
        return pa.int64()
    if isinstance(law, Choice):
        kinds = {type(value) for value in law.values}
        if kinds == {bool}:
            return pa.bool_()
        if kinds == {int}:
            return pa.int64()
        return pa.float64() if kinds <= {int, float} else pa.string()
    return pa.float64()


def _cell(value: Any, kind: pa.DataType) -> Any:
    if value is not None and kind == pa.string() and not isinstance(value, str):
        return json.dumps(value, sort_keys=True)
    return value
