"""The model (parameters, start, noise, tolerances) and the physics that closures and simulation
share."""

from rattle.scene import sources as sources  # first: it notes the sources before they are imported
from rattle.scene.errors import FileError as FileError
from rattle.scene.errors import InputError as InputError
from rattle.scene.errors import OutputError as OutputError
from rattle.scene.errors import RattleError as RattleError
from rattle.scene.errors import check_keys as check_keys
from rattle.scene.errors import choice as choice
from rattle.scene.errors import count as count
from rattle.scene.errors import finite as finite
from rattle.scene.errors import nearest as nearest
from rattle.scene.errors import positive as positive
from rattle.scene.gears import DAT21 as DAT21
from rattle.scene.gears import Gears as Gears
from rattle.scene.parts import Order as Order
from rattle.scene.parts import Restitution as Restitution
from rattle.scene.parts import Start as Start
from rattle.scene.parts import Tolerance as Tolerance
from rattle.scene.parts import Wheel as Wheel
from rattle.scene.scene import Scene as Scene
from rattle.scene.scene import check_each_impact as check_each_impact
from rattle.scene.scene import check_scene as check_scene
from rattle.scene.text import as_html as as_html
from rattle.scene.text import duration_text as duration_text
from rattle.scene.text import harmless as harmless
from rattle.scene.text import line as line
from rattle.scene.types import Bools as Bools
from rattle.scene.types import Constants as Constants
from rattle.scene.types import Floats as Floats
from rattle.scene.types import Ints as Ints
from rattle.scene.types import section_names as section_names
from rattle.scene.types import state_names as state_names
