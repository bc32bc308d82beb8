"""User input: descriptions of arms, scenarios and studies, in Python and in files.

This package imports no numerics and no NumPy.
"""

from flexarm.model.arm.joints import Friction as Friction
from flexarm.model.arm.joints import Joint as Joint
from flexarm.model.arm.joints import JointLimits as JointLimits
from flexarm.model.arm.joints import Winding as Winding
from flexarm.model.arm.links import Box as Box
from flexarm.model.arm.links import Circle as Circle
from flexarm.model.arm.links import Gauge as Gauge
from flexarm.model.arm.links import Link as Link
from flexarm.model.arm.links import Material as Material
from flexarm.model.arm.links import ModalDamping as ModalDamping
from flexarm.model.arm.links import RayleighDamping as RayleighDamping
from flexarm.model.arm.links import Rectangle as Rectangle
from flexarm.model.arm.links import SectionTable as SectionTable
from flexarm.model.arm.links import Tube as Tube
from flexarm.model.arm.mechanism import Base as Base
from flexarm.model.arm.mechanism import Closure as Closure
from flexarm.model.arm.mechanism import Payload as Payload
from flexarm.model.arm.spec import ArmSpec as ArmSpec
from flexarm.model.drives import TorqueDrive as TorqueDrive
from flexarm.model.environment import AccelerationTable as AccelerationTable
from flexarm.model.environment import Change as Change
from flexarm.model.environment import Contact as Contact
from flexarm.model.environment import FactorTable as FactorTable
from flexarm.model.environment import Load as Load
from flexarm.model.file_format.files import arm_spec_of_text as arm_spec_of_text
from flexarm.model.file_format.files import file_text as file_text
from flexarm.model.file_format.files import json_schema as json_schema
from flexarm.model.file_format.files import load_arm_spec as load_arm_spec
from flexarm.model.file_format.files import load_scenario as load_scenario
from flexarm.model.file_format.files import locate_scenario as locate_scenario
from flexarm.model.file_format.files import locate_study as locate_study
from flexarm.model.file_format.files import save_arm_spec as save_arm_spec
from flexarm.model.file_format.files import scenario_of_text as scenario_of_text
from flexarm.model.hardware import Hardware as Hardware
from flexarm.model.hardware import InertialSensor as InertialSensor
from flexarm.model.hardware import Instrument as Instrument
from flexarm.model.hardware import InstrumentFault as InstrumentFault
from flexarm.model.hardware import Motors as Motors
from flexarm.model.hardware import Sensor as Sensor
from flexarm.model.identification import Filter as Filter
from flexarm.model.identification import FreeParameter as FreeParameter
from flexarm.model.scenarios.scenario import EventSpec as EventSpec
from flexarm.model.scenarios.scenario import HeldJoint as HeldJoint
from flexarm.model.scenarios.scenario import JointEvent as JointEvent
from flexarm.model.scenarios.scenario import RunSpec as RunSpec
from flexarm.model.scenarios.scenario import Scenario as Scenario
from flexarm.model.scenarios.scenario import TabulatedJoint as TabulatedJoint
from flexarm.model.scenarios.study import PlantSpec as PlantSpec
from flexarm.model.scenarios.study import StudySpec as StudySpec
from flexarm.model.surfaces import RoundWall as RoundWall
from flexarm.model.surfaces import Surface as Surface
from flexarm.model.surfaces import SurfaceTable as SurfaceTable
from flexarm.model.surfaces import Wall as Wall
