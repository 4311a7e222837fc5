"""What a drone touches, by name."""

from pydrake.geometry import QueryObject
from pydrake.multibody.plant import ContactResults

FLOOR = ("ground", "pad")
TAKE_OFF = 0.4  # m above where the drone stands: only beyond is a contact a collision


def nearest_name(
    contacts: ContactResults, query: QueryObject, names: dict, airborne: bool
) -> str | None:
    """Returns the name of what pushes the drone, or in the air of what is nearest to it.

    Args:
        contacts, query: the plant's contacts now, and SceneGraph's.
        names: geometry IDs to names, of all that is not the drone's own.
        airborne: whether the drone has taken off; before, the floor does not count.
    """
    touching = [
        contacts.point_pair_contact_info(i).point_pair()
        for i in range(contacts.num_point_pair_contacts())
    ]
    pairs = [pair for pair in touching if _is_of_drone(pair, names)]
    if airborne and not pairs:
        near = query.ComputeSignedDistancePairwiseClosestPoints()
        pairs = [pair for pair in near if _is_of_drone(pair, names)]
        pairs.sort(key=lambda pair: pair.distance)
    for pair in pairs:
        name = names.get(pair.id_A) or names.get(pair.id_B)
        if name and (airborne or name not in FLOOR):
            return name
    return None


def _is_of_drone(pair, names):
    """Whether one of a pair of geometries is the drone's own."""
    return pair.id_A not in names or pair.id_B not in names
