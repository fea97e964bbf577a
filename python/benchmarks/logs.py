"""Reads logs of `skysink export --format mcap` and `mcap-ros2` with third-party readers.

JSON messages are checked against the schemas in their file, and those of Foxglove parsed into Foxglove's own messages,
which refuse fields that they do not have. Messages of ROS 2 are read by two decoders, which must agree with each other.
"""

import json
import sys
from collections import Counter
from datetime import datetime, timezone
from importlib import import_module
from pathlib import Path

import jsonschema
from google.protobuf import json_format
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_typestore


def with_times(value):
    """The message with `{sec, nsec}` as protobuf's JSON has times and durations."""
    if isinstance(value, list):
        return [with_times(item) for item in value]
    if not isinstance(value, dict):
        return value
    if value.keys() == {"sec", "nsec"}:
        return datetime.fromtimestamp(value["sec"] + value["nsec"] / 1e9, timezone.utc).isoformat()
    return {
        name: f"{item['sec']}s" if name == "lifetime" else with_times(item) for name, item in value.items()
    }


def check_json(schema, data):
    message = json.loads(data)
    jsonschema.validate(message, json.loads(schema.data))
    package, name = schema.name.split(".")
    if package == "foxglove":
        module = import_module(f"foxglove_schemas_protobuf.{name}_pb2")
        json_format.ParseDict(with_times(message), getattr(module, name)())


def agree(one, other):
    """Whether two decoded values are equal in the fields of the first."""
    if fields := getattr(one, "__slots__", None):
        return all(agree(getattr(one, name), getattr(other, name)) for name in fields)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(agree, one, other))
    return one == other or (one != one and other != other)  # or neither is a number


def main(files):
    factory = DecoderFactory()
    store = get_typestore(Stores.ROS2_JAZZY)
    for file in files:
        topics = Counter()
        with Path(file).open("rb") as stream:
            for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
                topics[f"{channel.topic} {schema.name}"] += 1
                if channel.message_encoding == "json":
                    check_json(schema, message.data)
                    continue
                decoded = factory.decoder_for(channel.message_encoding, schema)(message.data)
                own = store.deserialize_cdr(message.data, schema.name)
                if not agree(decoded, own):
                    print(f"{file}: {channel.topic}: {decoded} and {own}", file=sys.stderr)
                    return 1
        print(f"{file}: {', '.join(f'{topic} × {count}' for topic, count in sorted(topics.items()))}")
    return 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        print("usage: logs.py FILE.mcap...", file=sys.stderr)
        sys.exit(2)
    sys.exit(main(sys.argv[1:]))
