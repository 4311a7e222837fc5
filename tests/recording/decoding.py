"""Messages as a reader sees them that has only their schema."""

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass


def decoded(message):
    """Returns one of foxglove.messages, encoded and decoded again by Google's Protobuf."""
    schema = message.get_schema()
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString(message.encode())


def vector(message):
    """Returns x, y and z of a message."""
    return [message.x, message.y, message.z]
