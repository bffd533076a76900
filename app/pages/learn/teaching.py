"""What the teacher's page says: plan, goals, questions."""

from __future__ import annotations

from typing import Any

PLAN: tuple[tuple[int, str, str, dict[str, Any]], ...] = (
    (
        5,
        "Who made this gap?",
        "Show the counts. Collect explanations; keep them on the board.",
        {"lesson": "story", "step": 1},
    ),
    (
        5,
        "Pulled forward, falls back",
        "Let the class vote, then play the film. Why is the star behind?",
        {"lesson": "story", "step": 3},
    ),
    (8, "One fly-by", "Each pair changes mass and distance. Which gaps look the same?", {"lesson": "flyby"}),
    (
        7,
        "Many fly-bys, and counting",
        "A pattern instead of a gap; what 100 or 10,000 stars per bin can show.",
        {"lesson": "story", "step": 5},
    ),
    (
        5,
        "The odds of one number",
        "Read both curves. What would change your mind?",
        {"lesson": "story", "step": 7},
    ),
    (
        10,
        "Guess the mass",
        "Open a class below and give out the link: ten streams, and how sure one is.",
        {"lesson": "quiz"},
    ),
    (5, "Who it was", "Compare with the board. Who was surer than right?", {"lesson": "story", "step": 10}),
)
"""Minutes, title, what to do, and what to change in the session's link."""
GOALS = (
    "Say how a stellar stream forms, and why its density is smooth if nothing disturbs it.",
    "Explain with energy and orbits why a star that is pulled forward falls back.",
    "Tell a signal from the scatter of counting: √N, and what four times as many stars bring.",
    "Weigh two explanations by how often each would give what was seen.",
    "State how sure one is, and check it: be right nine times in ten when 90 % sure.",
)
QUESTIONS = (
    (
        "Why does a push forward make a star fall back?",
        "It gains energy, so its orbit becomes wider, and a wider orbit takes longer to go round. It "
        "runs ahead only "
        "at first. Brakes and satellites work the same way: to overtake, slow down.",
    ),
    (
        "Ten times the mass: is the gap ten times as deep?",
        "No. No place can lose more stars than it has. A heavy object makes the gap wider; its depth is "
        "limited.",
    ),
    (
        "A bin holds 100 stars where 110 are expected. Is that a gap?",
        "No: counts of 110 scatter by √110, about 10. One in six such bins is that low by chance alone.",
    ),
    (
        "Light and heavy objects can both make a small dip. How can they be told apart at all?",
        "Not by one dip. Heavy objects also make wide, deep gaps; light ones never do. The whole "
        "pattern decides.",
    ),
    (
        "Somebody says “90 % sure” ten times and is right six times. What should they say next time?",
        "About 60 %. The score rewards that: whoever states what they believe has the most points on "
        "average.",
    ),
    (
        "What could look like a dark object’s gap and be none?",
        "Clouds of gas, star clusters and spiral arms pull on stars too, and uneven surveys miss some. "
        "The models here "
        "leave these out; the caveats at the top of the page say so.",
    ),
)
