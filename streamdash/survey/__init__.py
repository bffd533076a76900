"""What a telescope sees of a stream: positions on the sky, bins, noise, and mock observations."""

from streamdash._public import offer

__getattr__, __dir__ = offer(
    __name__,
    {
        "add_noise": "streamdash.survey.sky",
        "bin_weights": "streamdash.survey.sky",
        "ell_to_theta": "streamdash.survey.sky",
        "from_theta": "streamdash.survey.sky",
        "longitude_bins": "streamdash.survey.sky",
        "observe": "streamdash.survey.sky",
        "q_rho": "streamdash.survey.sky",
        "shot_noise": "streamdash.survey.sky",
        "theta_to_ell": "streamdash.survey.sky",
        "to_theta": "streamdash.survey.sky",
    },
)
