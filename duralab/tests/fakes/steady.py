from duralab_bus import ServiceConfig, service_main

if __name__ == "__main__":
    service_main("steady", ServiceConfig, lambda _: lambda bus: None)
