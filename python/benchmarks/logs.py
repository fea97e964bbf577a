"""Reads logs of `skysink export --format mcap` with two decoders of ROS 2, which must agree with each other."""

import sys
from collections import Counter
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


def agree(one, other):
    """Whether two decoded values are equal in the fields of the first."""
    if fields := getattr(one, "__slots__", None):
        return all(agree(getattr(one, name), getattr(other, name)) for name in fields)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(agree, one, other))
    if isinstance(one, bytes):
        return one == bytes(other)
    return one == other or (one != one and other != other)  # or neither is a number


def main(files):
    store = get_typestore(Stores.ROS2_JAZZY)
    for file in files:
        topics = Counter()
        factory = DecoderFactory()  # it keeps the schemas of one file
        with Path(file).open("rb") as stream:
            for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
                topics[f"{channel.topic} {schema.name}"] += 1
                if schema.name not in store.types:
                    store.register(get_types_from_msg(schema.data.decode(), schema.name))
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
