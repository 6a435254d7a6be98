"""A robot as it was found: its points with what is uncertain about them, sensors, frames, and
whether to rely on it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.calibration.cables import axes_of, rollers_of, stiffness_of, told_errors
from steelyard.calibration.datum import Placed, placed
from steelyard.calibration.first_poses import UPRIGHT
from steelyard.calibration.fit import GeometryFit
from steelyard.calibration.gauge import Gauge, gauge_of
from steelyard.calibration.reasons import reasons_against
from steelyard.calibration.settings import CALIBRATION, CalibrationSettings
from steelyard.calibration.wrong_rows import WrongRow
from steelyard.digits import number
from steelyard.display import Display
from steelyard.estimates.estimate import (
    identifiable_parameters,
    named,
    plain,
    plausible_radius,
)
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameters,
    as_tree,
)
from steelyard.identification.weighing.tables import WrongWeight
from steelyard.inertia import Inertia, body_jacobian
from steelyard.instruments.length import CABLE_DAMPING, ROLLER, ROLLER_AXIS, STRETCH
from steelyard.robot.covariance import POINTS, names_of
from steelyard.robot.model import Robot

FORMAT = "steelyard-calibration/1"
_SEARCHED = frozenset({"gain", "offset", STRETCH, ROLLER, ROLLER_AXIS})
"""Errors of instruments that are looked for, and named where nothing tells them."""
_OF_CABLES = frozenset({STRETCH, ROLLER, ROLLER_AXIS, CABLE_DAMPING})
"""Errors that are null where nothing tells them: the file of the robot has what was known
before."""


@dataclass(frozen=True, eq=False)
class GeometryCalibration:
    """A robot as it was found, with what is uncertain about it."""

    found: GeometryFit
    settings: CalibrationSettings = CALIBRATION

    @property
    def experiment(self) -> Experiment:
        """That it was made from."""
        return self.found.experiment

    @property
    def arrived(self) -> bool:
        """Whether the fit has converged; otherwise points and errors are those of the description,
        and nothing is told.
        """
        return self.found.fit.converged

    @cached_property
    def placed(self) -> Placed:
        """All calibration parameters, in the world frame that a datum has defined where there is
        one.
        """
        return placed(self.found)

    @property
    def points(self) -> dict[str, Array]:
        """``anchor`` and ``attachment`` of every cable [m], shape (m, 3) each."""
        places = self.found.parameters.places
        values = self.placed.values
        return {key: values[places[ROBOT, key, None]].reshape(-1, 3) for key in POINTS}

    @property
    def moved(self) -> dict[str, Array]:
        """Found less drawn, of ``anchor`` and ``attachment`` [m], shape (m, 3) each; NaN where the
        fit has not converged.
        """
        drawn = _points_of(self.experiment.robot)
        known = 0.0 if self.arrived else np.nan
        return {key: value - drawn[key] + known for key, value in self.points.items()}

    @property
    def robot(self) -> Robot:
        """The robot with these, and with directions of the world in its frame."""
        points, robot, world = self.points, self.experiment.robot, self.placed.rotation
        cable, rollers, axes = self.stiffness, self.rollers, self.roller_axes
        robot = replace(robot, anchors=points["anchor"], attachments=points["attachment"])
        if cable is not None:
            robot = replace(robot, cable=replace(robot.cable, axial_stiffness=cable[0]))
        if rollers is not None:
            told = np.isfinite(rollers[0])
            radius = np.where(told, rollers[0], robot.pulley_radius)
            robot = replace(robot, pulley_radius=np.maximum(radius, 0.0))
        if axes is not None:
            leaning = np.where(np.isfinite(axes[0]), axes[0], robot.pulley_axis)
            robot = replace(robot, pulley_axis=leaning)
        if world is None:
            return robot
        place = self.found.parameters.places[ROBOT, "gravity", None]
        return replace(
            robot, pulley_axis=robot.pulley_axis @ world.T, gravity=self.placed.values[place]
        )

    @property
    def stiffness(self) -> tuple[float, float] | None:
        """Axial stiffness of the cables and its 1-sigma [N]; None: the readings do not tell it."""
        return stiffness_of(self.found, self.settings)

    @property
    def rollers(self) -> tuple[Array, Array] | None:
        """Radii of the rollers and their 1-sigma [m], NaN where the readings do not tell them,
        shape (m,) each; None: they tell none.
        """
        return rollers_of(self.found, self.settings)

    @property
    def roller_axes(self) -> tuple[Array, Array] | None:
        """Axes about which rollers swivel, in the world frame of the description, and 1-sigma of
        how they lean [rad], see :func:`.axes_of`; None: the readings tell none.
        """
        return axes_of(self.found, self.settings)

    @property
    def _axes_in_world(self) -> tuple[Array, Array] | None:
        """The same in the world frame of the file."""
        found, world = self.roller_axes, self.placed.rotation
        return found if found is None or world is None else (found[0] @ world.T, found[1])

    @cached_property
    def gauges(self) -> dict[str, Gauge]:
        """Whether the frames of anchors and attachments are tied."""
        robot, parameters = self.experiment.robot, self.found.parameters
        frames = {"anchor": "world frame", "attachment": "platform frame"}
        drawn = _points_of(robot)
        result = {}
        for key, frame in frames.items():
            place = parameters.places[ROBOT, key, None]
            own = self.placed.covariance[place, place]
            defined = self.placed.words if key == "anchor" else None
            result[key] = (
                gauge_of(frame, drawn[key], own, parameters.deviation[place])
                if defined is None
                else Gauge(frame, (), own, defined)
            )
        return result

    @property
    def frames(self) -> list[str]:
        """Whether the frames are tied, in words; a fit that has not converged does not say."""
        return [str(gauge) for gauge in self.gauges.values()] if self.arrived else []

    @property
    def deviations(self) -> dict[str, Array]:
        """1-sigma of ``anchor`` and ``attachment`` [m], shape (m, 3) each."""
        return {
            key: np.sqrt(np.maximum(np.diag(gauge.covariance), 0.0)).reshape(-1, 3)
            for key, gauge in self.gauges.items()
        }

    @property
    def told(self) -> dict[str, NDArray[np.bool_]]:
        """Which coordinates the readings tell, or are known, shape (m, 3) each."""
        return {
            key: self.exact[key] | self.arrived & (sigma < self.settings.told * self._before(key))
            for key, sigma in self.deviations.items()
        }

    @property
    def exact(self) -> dict[str, NDArray[np.bool_]]:
        """Which coordinates are stated as exact, so that nothing moves them, shape (m, 3) each."""
        return {key: self._before(key) == 0 for key in self.deviations}

    def _before(self, key: str) -> Array:
        """1-sigma of points beforehand [m], shape (m, 3)."""
        parameters = self.found.parameters
        return parameters.deviation[parameters.places[ROBOT, key, None]].reshape(-1, 3)

    @cached_property
    def covariance(self) -> Array:
        """Of anchors, then attachments, three coordinates a cable [m^2], shape (6 m, 6 m).

        With what is uncertain about frames that nothing ties and no datum defines: where sensors
        sit is told in the same platform frame, and there it matters.
        """
        use = self.found.parameters.of_geometry
        whole = self.placed.covariance[np.ix_(use, use)]
        return np.asarray((whole + whole.T) / 2)

    @property
    def names(self) -> list[str]:
        """Of its rows, such as ``anchor.1.x``."""
        return names_of(self.experiment.robot.m)

    @property
    def parameter_deviations(self) -> Array:
        """1-sigma of all calibration parameters, shape (u,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.placed.covariance), 0.0)))

    @property
    def reported(self) -> CalibrationParameters:
        """All calibration parameters, frames that were exact in another world as what they are
        now.
        """
        parameters = self.found.parameters
        if self.placed.rotation is None:
            return parameters
        exact = parameters.deviation == 0
        sigma = np.where(exact, self.parameter_deviations, parameters.deviation)
        return parameters.widened(sigma)

    @property
    def unobservable(self) -> list[str]:
        """What the readings do not tell, by name; a fit that has not converged does not say."""
        if not self.arrived:
            return []
        found = [
            f"{key}.{i + 1}.{'xyz'[j]}"
            for key, told in self.told.items()
            for i, j in zip(*np.nonzero(~told), strict=True)
        ]
        parameters = self.found.parameters
        sigma, weighed = self.found.deviations, set(parameters.of_weighed.tolist())
        for place, entry, i in parameters.components():
            searched = entry.key in _SEARCHED and entry.owner != ROBOT
            searched = searched and place not in weighed
            before = entry.deviation[i]
            if searched and before > 0 and sigma[place] > self.settings.told * before:
                found.append(parameters.names[place])
        return found

    @property
    def leave_one_out(self) -> Array | None:
        """Residual of each cable's lengths as all other readings predict them, root mean square
        [m], shape (m,); None: no lengths were read.
        """
        each = [one.residual for one in self.found.left_out]
        if not each:
            return None
        square = np.concatenate(each) ** 2
        there = np.isfinite(square).any(axis=0)
        rms = np.full(square.shape[1], np.nan)
        rms[there] = np.sqrt(np.nanmean(square[:, there], axis=0))
        return rms

    @cached_property
    def reasons(self) -> list[str]:
        """Why not to rely on it; none where it can be."""
        return reasons_against(self.found, self.settings)

    @property
    def wrong(self) -> list[WrongRow | WrongWeight]:
        """Rows of poses and of dead weights that were left out."""
        weighed = self.found.parameters.weighed
        return [*self.found.wrong, *(() if weighed is None else weighed.wrong)]

    @property
    def body(self) -> tuple[Array, Array] | None:
        """The ten body parameters of what hung there, NaN where they are not told, and their
        1-sigma, shape (10,) each; None: no forces were read.
        """
        if self.found.body is None:
            return None
        parameters, spread = self.found.body
        J = body_jacobian(parameters)
        covariance = J @ spread @ J.T
        size = plausible_radius(self.experiment.robot)
        value = Inertia.from_parameters(parameters).body_parameters
        known = identifiable_parameters(float(value[0]), covariance, size)
        known &= ~((np.arange(len(value)) == 0) & self.experiment.mass_assumed)
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return np.where(known, value, np.nan), np.where(known, sigma, np.nan)

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of ``calibration.json``; null where nothing is told."""
        told, deviations = self.told, self.deviations
        points = {
            f"{key}s": {
                "value": plain(np.where(told[key], value, np.nan)),
                "standard_deviation": plain(np.where(told[key], deviations[key], np.nan)),
                "moved": plain(self.moved[key]),
            }
            for key, value in self.points.items()
        }
        one_out, body = self.leave_one_out, self.body
        return {
            "format": FORMAT,
            "experiment": self.experiment.name,
            "robot": self.experiment.robot.name,
            **points,
            **(
                {}
                if body is None
                else {"body": {**named(body[0]), "standard_deviation": named(body[1])}}
            ),
            "axial_stiffness": _pair(self.stiffness),
            "pulley_radius": _pair(self.rollers),
            "pulley_axis": _pair(self._axes_in_world),
            "calibration": plain(self._errors()),
            "residuals": {
                "leave_one_out": None if one_out is None else plain(one_out),
                "in_units_of_noise": {
                    f"{name}.{quantity.removesuffix(' at rest')}": float(np.sqrt(ratio))
                    for (name, quantity), ratio in self.found.fit.ratios.items()
                    if name != UPRIGHT
                },
            },
            "gauge": self.frames,
            **self._datum(),
            "unobservable": self.unobservable,
            "wrong_rows": [str(each) for each in self.wrong],
            "notes": list(self.found.notes),
            "verdict": {"accepted": not self.reasons, "reasons": self.reasons},
        }

    def _errors(self) -> dict[str, Any]:
        """All calibration parameters in the shape of the contract; null where nothing is told of
        stretch and rollers, which the file of the robot has, and of damping, and all of them where
        the fit has not converged.
        """
        values, sigma = self.placed.values.copy(), self.parameter_deviations.copy()
        if not self.arrived:
            values[:] = sigma[:] = np.nan
        told = told_errors(self.found, self.settings)
        for place, entry, _ in self.found.parameters.components():
            of_cables = entry.key in _OF_CABLES
            if of_cables and not told[place]:
                values[place] = sigma[place] = np.nan
        return as_tree(self.experiment, self.reported, values, sigma)

    def _datum(self) -> dict[str, Any]:
        """How the world of the datum lies in that of the description."""
        world = self.placed
        if world.rotation is None or world.spread is None:
            return {}
        sigma = np.sqrt(np.maximum(np.diag(world.spread), 0.0))
        turned = Rotation.from_matrix(world.rotation).as_rotvec()
        entry = {
            "translation": {"value": world.translation, "standard_deviation": sigma[:3]},
            "rotation": {"value": turned, "standard_deviation": sigma[3:]},
        }
        return {"datum": {"world_from_described": plain(entry)}}

    def __repr__(self) -> str:
        return self._display().text()

    def _repr_html_(self) -> str:
        return self._display().html()

    def _display(self) -> Display:
        """Points with their 1-sigma, and the verdict."""
        rows = []
        told, deviations = self.told, self.deviations
        for key, value in self.points.items():
            for i, (point, sigma) in enumerate(zip(value, deviations[key], strict=True)):
                cells = [
                    number(float(v), float(s)) if known else "not told"
                    for v, s, known in zip(point, sigma, told[key][i], strict=True)
                ]
                rows.append((f"{key} {i + 1}", "m", *cells))
        said = "accepted" if not self.reasons else "not accepted"
        return Display(
            f"{self.experiment.robot.name}: {said}",
            tuple(rows),
            head=("", "", "x", "y", "z"),
            sentences=(
                *self.reasons,
                *(str(each) for each in self.wrong),
                *self.found.notes,
            ),
        )


def _pair(found: tuple[Any, Any] | None) -> dict[str, Any] | None:
    """A value and its 1-sigma in the shape of the contract."""
    if found is None:
        return None
    return {"value": plain(found[0]), "standard_deviation": plain(found[1])}


def _points_of(robot: Robot) -> dict[str, Array]:
    """Anchors and attachments as they were drawn."""
    return {"anchor": robot.anchors, "attachment": robot.attachments}
