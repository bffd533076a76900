"""The cache: entries named by their configuration, written, read, checked and carried. No physics."""

from streamdash._public import offer

__getattr__, __dir__ = offer(
    __name__,
    {
        "BusyError": "streamdash.store.cache",
        "Cache": "streamdash.store.cache",
        "StoreError": "streamdash.store.cache",
    },
)
