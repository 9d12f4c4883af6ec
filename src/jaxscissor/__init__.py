"""Kinematics of parallel robots with scissor legs, differentiable from end to end."""

from jaxscissor._solution import Solution as Solution
from jaxscissor._solution import Status as Status
from jaxscissor.kinematics import forward_kinematics as forward_kinematics
from jaxscissor.kinematics import inverse_kinematics as inverse_kinematics
from jaxscissor.kinematics import residual as residual
from jaxscissor.mechanisms.triple_scissor import SLIDE_ANGLES as SLIDE_ANGLES
from jaxscissor.mechanisms.triple_scissor import TripleScissorExtender as TripleScissorExtender
from jaxscissor.scissor import Scissor as Scissor
