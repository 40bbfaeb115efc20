from duralab_proto.v1.identifier_pb2 import Model
from identifier.modelling import ModelCache


def test_the_model_not_used_for_longest_gives_way():
    cache = ModelCache(2)
    cache.put(Model(id="a"))
    cache.put(Model(id="b"))
    assert cache.get("a") is not None
    cache.put(Model(id="c"))
    assert cache.get("b") is None
    assert cache.get("a") is not None
    assert cache.get("c") is not None
