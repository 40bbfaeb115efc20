from duralab_proto.v1.identifier_pb2 import Model
from identifier.modelling import ModelShelf


def test_the_model_not_used_for_longest_gives_way():
    shelf = ModelShelf(2)
    shelf.put(Model(id="a"))
    shelf.put(Model(id="b"))
    assert shelf.get("a") is not None
    shelf.put(Model(id="c"))
    assert shelf.get("b") is None
    assert shelf.get("a") is not None
    assert shelf.get("c") is not None
