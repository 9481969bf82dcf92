"""Flights along placed cameras, as a feature: what they write and draw."""

from dataclasses import fields

from rastercov.base import ConfigError
from rastercov.core.mesh import Mesh
from rastercov.placement.plan.file import Plan, errors_at
from rastercov.placement.plan.legs import Airspace
from rastercov.placement.plan.phases import Figure
from rastercov.placement.plan.run import Placement, Products
from rastercov.placement.plan.scene import keep_outs
from rastercov.survey.flight import Flight, flight_of


class _Written(Flight):
    def files(self) -> dict[str, bytes]:
        """See `Product`."""
        from rastercov.survey.geo.flight import files_of

        return files_of(self)

    def figure(self) -> Figure:
        """Map of the route."""
        from rastercov.report.pages import render
        from rastercov.survey.geo.route import route_of

        route = route_of(self)
        values = {"route": route, "missions": self.table(), "asked": self.asked, "home": self.home}
        return Figure("Flight", render("flight.html", "rastercov.survey", **values), route["words"])


class _Flights(Products):
    def check_scene(self, plan: Plan, mesh: Mesh) -> None:
        """The origin must fit the scene."""
        if plan.flight is not None and (place := plan.flight.place) is not None:
            with errors_at(plan.name, "flight.origin", ConfigError):
                place.check_scene(mesh.bounds)

    def of(self, placement: Placement) -> Flight | None:
        """Flight along the placed cameras, if the plan has one."""
        prepared, cameras = placement.prepared, placement.cameras
        plan = prepared.plan
        if plan.flight is None or not len(cameras.mounted) or not plan.chooses_cameras:
            return None
        space = Airspace(prepared.mesh, plan.constraints.clearance, keep_outs(plan))
        found = flight_of(cameras, plan.flight, space, prepared.mounts, placement.chosen)
        return _Written(*(getattr(found, each.name) for each in fields(found)))


HOOKS = _Flights()
"""Hooks of this feature."""
