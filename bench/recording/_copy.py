"""Items of one MCAP file carried over into another."""

from __future__ import annotations

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import Writer

from ._container import Item


class ItemCopy:
    """Carries items into a writer, which numbers schemas and channels anew."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        # MCAP: schema 0 means that a channel has none.
        self._schemas = {0: 0}
        self._channels: dict[int, int] = {}
        self.messages = self.attachments = self.metadata = 0

    def add(self, item: Item) -> None:
        """Write one item, with its bytes and times as they are."""
        match item:
            case Message():
                channel = self._channels.get(item.channel_id)
                if channel is not None:
                    self._writer.add_message(
                        channel, item.log_time, item.data, item.publish_time, item.sequence
                    )
                    self.messages += 1
            case Schema() if item.id not in self._schemas:
                self._schemas[item.id] = self._writer.register_schema(item.name, item.encoding, item.data)
            case Channel() if item.id not in self._channels:
                schema = self._schemas.get(item.schema_id, 0)
                channel = self._writer.register_channel(
                    item.topic, item.message_encoding, schema, item.metadata
                )
                self._channels[item.id] = channel
            case Attachment():
                self._writer.add_attachment(
                    item.create_time, item.log_time, item.name, item.media_type, item.data
                )
                self.attachments += 1
            case Metadata():
                self._writer.add_metadata(item.name, item.metadata)
                self.metadata += 1
