"""Serve the rigs of installed plug-ins: `python -m duralab_gateway --config FILE`."""

from duralab_gateway.gateway_process import serve_plugins

if __name__ == "__main__":
    serve_plugins()
