"""The paper's second method: gradient-boosted trees that tell the classes apart (paper §2.5, §3.2)."""

from streamdash._public import offer

__getattr__, __dir__ = offer(
    __name__,
    {
        "Judged": "streamdash.classifier.train",
        "boost": "streamdash.classifier.train",
        "check_noise": "streamdash.classifier.train",
        "fit_temperature": "streamdash.classifier.train",
        "judge": "streamdash.classifier.train",
        "model_key": "streamdash.classifier.train",
        "train": "streamdash.classifier.train",
    },
)
