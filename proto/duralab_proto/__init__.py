"""The contract: generated messages, keys and array codecs."""
