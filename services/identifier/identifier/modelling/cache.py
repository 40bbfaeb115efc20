"""Cache of the models that a running identifier can return."""

import threading
from collections import OrderedDict

from duralab_proto.v1 import identifier_pb2


class ModelCache:
    """Cache of the most recently used models; the recorder stores all models, this cache does not.

    `capacity`: Number of cached models, 1 or more.
    Raises `ValueError`: The capacity is below 1.
    """

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"The cache is to hold {capacity} models; it must hold 1 or more.")
        self.capacity = capacity
        self._models: OrderedDict[str, identifier_pb2.Model] = OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._models)

    def put(self, model: identifier_pb2.Model) -> None:
        """Add a model; drop the least recently used one if the cache is full.

        `model`: Model with its id.
        """
        with self._lock:
            self._models[model.id] = model
            self._models.move_to_end(model.id)
            while len(self._models) > self.capacity:
                self._models.popitem(last=False)

    def get(self, id: str) -> identifier_pb2.Model | None:
        """Look up a model.

        `id`: Hash of its content.
        Returns: None if it is not cached.
        """
        with self._lock:
            model = self._models.get(id)
            if model is not None:
                self._models.move_to_end(id)
            return model
