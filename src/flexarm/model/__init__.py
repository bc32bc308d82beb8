"""User input: descriptions of arms, scenarios and studies, in Python and in files.

This package imports no numerics and no NumPy.
"""

from flexarm.model.contacts import ContactSpec as ContactSpec
from flexarm.model.contacts import RoundWallSpec as RoundWallSpec
from flexarm.model.contacts import SurfaceTableSpec as SurfaceTableSpec
from flexarm.model.contacts import WallSpec as WallSpec
from flexarm.model.damping import ModalDamping as ModalDamping
from flexarm.model.damping import RayleighDamping as RayleighDamping
from flexarm.model.drives import NoDrive as NoDrive
from flexarm.model.drives import RigidInverseDynamicsDrive as RigidInverseDynamicsDrive
from flexarm.model.drives import TorqueDrive as TorqueDrive
from flexarm.model.events import EventSpec as EventSpec
from flexarm.model.events import JointEvent as JointEvent
from flexarm.model.events import TipEvent as TipEvent
from flexarm.model.files import arm_spec_of_text as arm_spec_of_text
from flexarm.model.files import file_text as file_text
from flexarm.model.files import load_arm_spec as load_arm_spec
from flexarm.model.files import load_scenario as load_scenario
from flexarm.model.files import locate_scenario as locate_scenario
from flexarm.model.files import locate_study as locate_study
from flexarm.model.files import save_arm_spec as save_arm_spec
from flexarm.model.files import save_scenario as save_scenario
from flexarm.model.files import scenario_of_text as scenario_of_text
from flexarm.model.hardware import HardwareSpec as HardwareSpec
from flexarm.model.joints import Friction as Friction
from flexarm.model.joints import Joint as Joint
from flexarm.model.joints import JointLimits as JointLimits
from flexarm.model.joints import Payload as Payload
from flexarm.model.links import Gauge as Gauge
from flexarm.model.links import Link as Link
from flexarm.model.loads import LoadSpec as LoadSpec
from flexarm.model.motions import JointMotionSpec as JointMotionSpec
from flexarm.model.motions import LineMotionSpec as LineMotionSpec
from flexarm.model.prescribed import FollowingJoint as FollowingJoint
from flexarm.model.prescribed import HeldJoint as HeldJoint
from flexarm.model.prescribed import TabulatedJoint as TabulatedJoint
from flexarm.model.scenario import InitialState as InitialState
from flexarm.model.scenario import RunSettings as RunSettings
from flexarm.model.scenario import Scenario as Scenario
from flexarm.model.schema import json_schema as json_schema
from flexarm.model.sections import MATERIALS as MATERIALS
from flexarm.model.sections import Box as Box
from flexarm.model.sections import Circle as Circle
from flexarm.model.sections import Material as Material
from flexarm.model.sections import Rectangle as Rectangle
from flexarm.model.sections import SectionTable as SectionTable
from flexarm.model.sections import Tube as Tube
from flexarm.model.spec import ArmSpec as ArmSpec
from flexarm.model.study import PlantSpec as PlantSpec
from flexarm.model.study import Study as Study
from flexarm.model.tables import AccelerationTable as AccelerationTable
from flexarm.model.tables import FactorTable as FactorTable
