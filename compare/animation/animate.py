"""An animation from Python: shown in a notebook, or written as the command ``rattle animate``
writes it."""

from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from rattle.compare.animation.page import animation, write_animation
from rattle.compare.animation.record import Recording, record
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.scene import Scene, check_scene
from rattle.scene.numpy_errors import numpy_defaults

HEIGHT = 760  # pixels of an animation in a notebook


@numpy_defaults
@dataclass(frozen=True, repr=False)
class Animation:
    """The moving wheels or bodies of a scene, from `animate`: the noise-free orbit beside one noisy
    path.

    Attributes
    ----------
    recording : Recording
        Both paths: ``orbit`` and ``path`` have the displacements over time and the impacts.
    name : str
        The name in its title.
    html : str
        The whole file; it needs no other.

    Examples
    --------
    >>> from rattle import DAT21, Scene, animate
    >>> animate(Scene.from_gears(DAT21, sigma=0.1), impacts=4).recording.orbit.impacts
    4
    """

    recording: Recording
    name: str
    html: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "html", animation(self.recording, self.name))

    def __repr__(self) -> str:
        return f"Animation: {self.recording.sentence}"

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.html)}" width="100%" height="{HEIGHT}"'
            ' style="border:0"></iframe>'
        )

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write it as one HTML file, which any browser opens.

        Parameters
        ----------
        path : str or Path
            The file; its name ends in ``.html``.
        overwrite : bool
            Whether an earlier animation there may be replaced.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        OutputError
            If the file cannot be written, or exists and is no animation that may be replaced.
        """
        write_animation(Path(path), self.recording, self.name, overwrite=overwrite)
        return Path(path)


@numpy_defaults
def animate(
    scene: Scene,
    *,
    periods: int | None = None,
    impacts: int | None = None,
    rng: Rng = 0,
    name: str = "scene",
) -> Animation:
    """Draw the moving wheels or bodies of a scene: the noise-free orbit beside one noisy path.

    Parameters
    ----------
    scene : Scene
        What is modelled, with noise or a random tolerance.
    periods : int, optional
        Periods of the excitation to show, 1 to 60, after the transient of the noise-free orbit; 4
        by default.
    impacts : int, optional
        In place of it: the first impacts of the noise-free orbit after the start of the scene.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed of the noisy path; a generator of numpy gives a child of its seed sequence, another one
        each time.
    name : str
        A name for the title.

    Returns
    -------
    Animation
        A notebook shows it, ``save`` writes it.

    Raises
    ------
    InputError
        If nothing is random, or the orbit has fewer impacts, or comes to rest.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> str(animate(Scene.from_gears(DAT21, sigma=0.1), impacts=4)).split(";")[0]
    'Animation: 4 impacts without noise, 4 with noise in the same time'
    """
    check_scene(scene)
    seed = read_whole_seed(rng)
    return Animation(record(scene, periods=periods, impacts=impacts, seed=seed), name)
