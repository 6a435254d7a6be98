"""CASPR (github.com/darwinlau/CASPR): one XML file of bodies and one of cables, lengths in metres.

What its classes do with the numbers: ``BodyModelRigid`` (inertia), ``CableAttachmentPoint`` (what
platform points are measured from), ``BaseRotatingPulleyAttachment`` (roller: centre beside the
entry point, square to the entry vector, towards the platform; the cable leaves on the side that the
vector points to), ``CableModelLinearSpring`` (stiffness K over length), ``SystemModel`` (gravity).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from steelyard.errors import InputError
from steelyard.imports.description import Cable, DescribedBody, Description, Vector
from steelyard.imports.sources import Source, printable
from steelyard.imports.xml_file import Element

NAME = "CASPR XML"

_GRAVITY = (0.0, 0.0, -9.81)
"""Of CASPR, which states none in its files [m/s^2]."""
_FREE_JOINTS = {"SPATIAL_EULER_XYZ": 6, "SPATIAL_QUATERNION": 7}
"""Joints that carry nothing, with their number of coordinates; the first three are the position."""
_HALF_TURN = 3.14
"""Limit of an angle that is none [rad]: CASPR writes pi with two digits and more."""
_VARIABLE_STIFFNESS = {
    "cable_vsd_flexure_linear",
    "cable_vsd_polynomial",
    "cable_vsd_torsion_spring",
}
_CABLES = {"cable_ideal", "cable_linear_spring", *_VARIABLE_STIFFNESS}
_READ = {"force_min", "force_max", "diameter", "K"}

_PRODUCTS = (
    "as in CASPR's model of CoGiRo, which has them from the data sheet of the robot; CASPR's own"
    " equations put them into the inertia matrix as they stand, which --products matrix does too"
)


def recognises(source: Source) -> bool:
    """Whether a file is one of CASPR's bodies or cables."""
    return isinstance(source, Element) and source.tag in {"bodies_system", "cables"}


def describe(sources: Sequence[Source], cable_set: str | None) -> Description:
    """The robot of a file of bodies and a file of cables, in any order.

    Args:
        sources: Both.
        cable_set: Identifier of one of the sets of cables; None: the one that the file names.

    Raises:
        InputError: A file is missing or wrong, or this is no platform that only cables hold.
    """
    bodies, cables = _pair(sources)
    link = _link(bodies)
    origin = link.child("parent").child("location").vector()
    chosen, notes = _chosen(cables, cable_set)
    cog = link.child("physical").child("com_location").vector()
    limits, joint_notes = _limits(link.child("joint"), origin)
    return Description(
        format=NAME,
        files=(bodies.path, cables.path),
        name=link.attributes.get("name", ""),
        cables=tuple(_cable(each, cog, link) for each in chosen.children),
        body=_body(link),
        gravity=_GRAVITY,
        limits=limits,
        notes=(
            *notes,
            *_reference_note(chosen, cog),
            f"gravity {-_GRAVITY[2]} m/s^2 along -z: CASPR's constant, not in its files",
            *joint_notes,
            *_cable_notes(chosen),
            *_unread_note(link, chosen),
        ),
    )


def _pair(sources: Sequence[Source]) -> tuple[Element, Element]:
    """The files of bodies and of cables."""
    found: dict[str, Element] = {}
    for source in sources:
        if isinstance(source, Element):
            if source.tag in found:
                raise source.error(
                    f"expected one file with this root, found {found[source.tag].path} too; leave"
                    " one out"
                )
            found[source.tag] = source
    for tag, ending in (("bodies_system", "_bodies.xml"), ("cables", "_cables.xml")):
        if tag not in found:
            raise InputError(
                f"{sources[0].path}: expected a second file, *{ending} of CASPR with the root"
                f" '{tag}', found none; name both"
            )
    return found["bodies_system"], found["cables"]


def _link(bodies: Element) -> Element:
    """The only link, which nothing but cables holds."""
    links = bodies.child("links").children
    if len(links) != 1 or links[0].tag != "link_rigid":
        raise bodies.error(
            f"expected one 'link_rigid', found {len(links)} links; a robot file describes one"
            " platform, so this model cannot become one"
        )
    link = links[0]
    joint = link.child("joint")
    if joint.attribute("type") not in _FREE_JOINTS:
        raise joint.error(
            f"expected a joint that carries nothing ({', '.join(_FREE_JOINTS)}), found"
            f" '{joint.attribute('type')[:60]}'; a robot file describes a platform that cables"
            " alone hold"
        )
    if joint.attributes.get("actuated") == "true":
        raise joint.error(
            "expected a joint without actuator, found one; a robot file has cables only"
        )
    return link


def _body(link: Element) -> DescribedBody:
    """Mass, centre of gravity and inertia of a link."""
    physical = link.child("physical")
    inertia = physical.child("inertia")
    reference = inertia.attribute("ref")
    if reference not in {"com", "joint"}:
        raise inertia.error(f"expected ref 'com' or 'joint', found '{reference[:60]}'; correct it")

    def three(keys: str) -> Vector:
        x, y, z = (inertia.child(key).number() for key in keys.split())
        return x, y, z

    return DescribedBody(
        where=physical.where,
        mass=_positive(physical.child("mass")),
        center_of_gravity=physical.child("com_location").vector(),
        moments=three("Ixx Iyy Izz"),
        products=three("Iyz Ixz Ixy"),
        convention="integral",
        reason=_PRODUCTS,
        about="cog" if reference == "com" else "origin",
    )


def _positive(element: Element) -> float:
    value = element.number()
    if value <= 0:
        raise element.error(f"expected a number above 0, found {value:g}; correct it")
    return value


def _limits(joint: Element, origin: Vector) -> tuple[dict[str, object], tuple[str, ...]]:
    """Box of the position of the platform, and what of the limits could not be taken over."""
    if "q_min" not in joint.attributes or "q_max" not in joint.attributes:
        return {}, ()
    count = _FREE_JOINTS[joint.attribute("type")]
    low, high = (joint.numbers_of(key, count, infinite=True) for key in ("q_min", "q_max"))
    notes = []
    turns = zip(low[3:], high[3:], strict=True)
    if count == 6 and any(a > -_HALF_TURN or b < _HALF_TURN for a, b in turns):
        notes.append(
            "limits of rotation left out: CASPR's angles are R = Rx Ry Rz, those of a robot file R"
            " = Rz Ry Rx; write limits.rpy_deg yourself"
        )
    lower = [round(o + q, 12) for o, q in zip(origin, low[:3], strict=True)]
    upper = [round(o + q, 12) for o, q in zip(origin, high[:3], strict=True)]
    box = [lower, upper]
    if not all(math.isfinite(a) and math.isfinite(b) and a < b for a, b in zip(*box, strict=True)):
        return {}, (*notes, "limits of position left out: q_min and q_max are no box")
    return {"position": box}, tuple(notes)


def _chosen(cables: Element, name: str | None) -> tuple[Element, list[str]]:
    """A set of cables, and that there are others."""
    sets = cables.all("cable_set")
    names = [each.attribute("id") for each in sets]
    if not sets:
        raise cables.error("expected a 'cable_set', found none; add it")
    known = ", ".join(printable(each) for each in names)
    if len(set(names)) < len(names):
        raise cables.error(
            f"expected each 'cable_set' with an id of its own, found {known}; rename one"
        )
    if name is not None:
        if name not in names:
            raise InputError(
                f"--cables: expected one of {known}, found '{printable(name)}'; choose one of these"
            )
        wanted = name
    elif len(sets) == 1:
        wanted = names[0]
    else:
        wanted = cables.attributes.get("default_cable_set", "")
        if wanted not in names:
            raise cables.error(
                f"expected 'default_cable_set' to be one of {known}, found '{printable(wanted)}';"
                " choose a set with --cables"
            )
    others = ", ".join(printable(each) for each in names if each != wanted)
    note = f"cable set '{printable(wanted)}'; there are also {others} (--cables)"
    return sets[names.index(wanted)], [note] if others else []


def _cable(cable: Element, cog: Vector, link: Element) -> Cable:
    """A cable from its anchor to its attachment on the platform."""
    if cable.tag not in _CABLES:
        raise cable.error(
            f"expected one of {', '.join(sorted(_CABLES))}, found '{cable.tag[:60]}'; leave it out"
        )
    base, platform = _routing(cable, link.attribute("num"))
    reference = cable.attribute("attachment_reference")
    if reference not in {"joint", "com"}:
        raise cable.error(
            f"expected attachment_reference 'joint' or 'com', found '{reference[:60]}'; correct it"
        )
    point = platform[0].child("location").vector()
    x, y, z = (
        (round(p + c, 12) for p, c in zip(point, cog, strict=True)) if reference == "com" else point
    )
    properties = cable.child("properties")

    def number(tag: str, *, infinite: bool = False) -> float | None:
        found = properties.find(tag)
        return None if found is None else found.number(infinite=infinite)

    stiffness = properties.find("K") if cable.tag == "cable_linear_spring" else None
    highest = number("force_max", infinite=True)
    diameter = number("diameter")
    anchor, radius, axis = _leaving(base[-1])
    return Cable(
        where=cable.where,
        anchor=anchor,
        attachment=(x, y, z),
        radius=radius,
        axis=axis,
        lowest_tension=number("force_min"),
        highest_tension=None if highest is not None and math.isinf(highest) else highest,
        diameter=diameter or None,
        axial_stiffness=None if stiffness is None else _positive(stiffness),
    )


def _routing(cable: Element, platform: str) -> tuple[Sequence[Element], Sequence[Element]]:
    """Points of a cable on the base, from the winch on, and on the platform, from the base on."""
    points = cable.child("attachments").children
    for point in points:
        if point.tag not in {"attachment", "base_rotating_pulley"}:
            raise point.error(
                f"expected 'attachment' or 'base_rotating_pulley', found '{point.tag[:60]}'; a"
                " robot file has no such anchor"
            )
    links = [
        "0" if point.tag == "base_rotating_pulley" else point.child("link").text for point in points
    ]
    if links and links[0] != "0":
        points, links = points[::-1], links[::-1]
    on_base = links.count("0")
    wanted = ["0"] * on_base + [platform] * (len(links) - on_base)
    if links != wanted or not 0 < on_base < len(links):
        raise cable.error(
            f"expected points on link 0 and then on link {platform[:10]}, found links"
            f" {', '.join(each[:10] for each in links[:10])}; a cable of a robot file goes from the"
            " base to the platform once"
        )
    return points[:on_base], points[on_base:]


def _leaving(point: Element) -> tuple[Vector, float, Vector]:
    """Anchor, radius of its roller, and direction in which the cable enters that."""
    if point.tag == "attachment":
        return point.child("location").vector(), 0.0, (0.0, 0.0, 1.0)
    axis = point.child("cable_entry_vector")
    if math.hypot(*axis.vector()) < 1e-9:
        raise axis.error("expected a direction, found a vector of length 0; correct it")
    radius = point.child("pulley_radius")
    if radius.number() < 0:
        raise radius.error(f"expected a number at least 0, found {radius.number():g}; correct it")
    return point.child("fixed_location").vector(), radius.number(), axis.vector()


def _reference_note(chosen: Element, cog: Vector) -> Iterator[str]:
    """Note of attachments that are measured from the centre of gravity."""
    references = [each.attributes.get("attachment_reference") for each in chosen.children]
    if "com" in references and any(cog):
        yield (
            f"attachments of {references.count('com')} cables are measured from the centre of"
            f" gravity: ({', '.join(f'{v:g}' for v in cog)}) m was added"
        )


def _cable_notes(chosen: Element) -> Iterator[str]:
    """Notes of what the stiffness of cables was taken from, and of points that are left out."""
    variable = [each for each in chosen.children if each.tag in _VARIABLE_STIFFNESS]
    if any(each.tag == "cable_linear_spring" for each in chosen.children):
        yield "axial_stiffness is K of 'cable_linear_spring', which CASPR divides by the length"
    if variable:
        yield (
            f"stiffness of {len(variable)} cables left out: it depends on the tension"
            f" ('{variable[0].tag}')"
        )
    longer = [each for each in chosen.children if len(each.child("attachments").children) > 2]
    if longer:
        yield (
            f"of {len(longer)} cables, points before the last on the base and after the first on"
            " the platform are left out: the lengths between them do not change"
        )


def _unread_note(link: Element, chosen: Element) -> Iterator[str]:
    """Note of elements that are not read."""
    read = [each for each in chosen.children if each.tag not in _VARIABLE_STIFFNESS]
    tags = {part.tag for cable in read for part in cable.child("properties").children} - _READ
    end = link.child("physical").find("end_location")
    if end is not None and any(end.vector()):
        tags.add("end_location")
    if tags:
        yield f"not read: {', '.join(printable(tag) for tag in sorted(tags)[:12])}"
