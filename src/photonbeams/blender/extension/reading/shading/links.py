"""Links of shader nodes, through reroutes, muted nodes and groups."""

from __future__ import annotations

from typing import Any


def output_of(tree: Any, kind: str) -> Any:
    """Return the active output node of a material, a world or a light; None if there is none."""
    for target in ("CYCLES", "ALL", "EEVEE"):
        found = tree.get_output_node(target) if hasattr(tree, "get_output_node") else None
        if found is not None:
            return found
    return next((node for node in tree.nodes if node.type == kind), None)


def source_at(tree: Any, kind: str, name: str) -> Any:
    """Return the socket that an input of the active output node is linked to; None if there is none."""
    output = output_of(tree, kind)
    return None if output is None else source_of(output.inputs[name])


def node_behind(socket: Any) -> Any:
    """Return the node that a socket is linked to; None if there is none."""
    source = source_of(socket)
    return None if source is None else source.node


class _Inputs(list[Any]):
    """The inputs of a node inside of groups, by their places or names."""

    def __getitem__(self, key: Any) -> Any:
        socket = self.get(key) if isinstance(key, str) else super().__getitem__(key)
        if socket is None:
            raise KeyError(key)
        return socket

    def __contains__(self, name: object) -> bool:
        return self.get(name) is not None

    def get(self, name: object) -> Any:
        """Return the input of a name; None if there is none."""
        return next((socket for socket in self if socket.name == name), None)


class Inside:
    """A node, or a socket, in the tree of a group: what the group's inputs are depends on the node of the group.

    Parameters
    ----------
    own
        Blender's node or socket, whose attributes it has.
    groups
        The nodes of the groups that it is in, from the outermost.
    """

    def __init__(self, own: Any, groups: tuple[Any, ...]) -> None:
        self.own, self.groups = own, groups

    def __getattr__(self, name: str) -> Any:
        return getattr(self.own, name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Inside) and (self.own, self.groups) == (other.own, other.groups)

    def __hash__(self) -> int:
        return hash(self.own)

    @property
    def node(self) -> Any:
        """The node of a socket."""
        return Inside(self.own.node, self.groups)

    @property
    def inputs(self) -> Any:
        """The inputs of a node."""
        return _Inputs(Inside(socket, self.groups) for socket in self.own.inputs)


def source_of(socket: Any) -> Any:
    """Return the socket that a socket is linked to, beyond reroutes and into groups; None if there is none."""
    found = linked_to(socket)
    return None if found is None or not found.is_output else found


def linked_to(socket: Any) -> Any:
    """Return the output that makes a socket's value, or the unlinked input of a group that has it; else None."""
    if socket is None or not socket.is_linked or socket.links[0].is_muted:
        return None
    own, groups = (socket.own, socket.groups) if isinstance(socket, Inside) else (socket, ())
    found = own.links[0].from_socket
    node = found.node
    if node.mute:
        return _passed(node, found, groups)
    if node.type == "REROUTE":
        return linked_to(Inside(node.inputs[0], groups))
    if node.type == "GROUP" and node.node_tree is not None:
        inside = next((each for each in node.node_tree.nodes if each.type == "GROUP_OUTPUT" and each.is_active_output),
                      None)  # fmt: skip
        out = None if inside is None else inside.inputs.get(found.name)
        return None if out is None else _or_own(Inside(out, (*groups, Inside(node, groups))))
    if node.type == "GROUP_INPUT" and groups:
        outside = groups[-1].inputs.get(found.name)
        return None if outside is None else _or_own(outside)
    return Inside(found, groups)


def _or_own(socket: Any) -> Any:
    """Return what a socket is linked to, or itself if it is not."""
    return linked_to(socket) if socket.is_linked else socket


def _passed(node: Any, output: Any, groups: tuple[Any, ...]) -> Any:
    """Return what a muted node lets through to an output."""
    link = next((each for each in node.internal_links if each.to_socket == output), None)
    return None if link is None else _or_own(Inside(link.from_socket, groups))
