"""What a report says of a twin: how well it fits, its contacts and their fabric."""

from __future__ import annotations

from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.core.units import unit_label
from mbstudio.scene.figures.fabric_figure import fabric_figure
from mbstudio.scene.reports.blocks import Block, Facts, Heading, Paragraph, Picture


def twin_blocks(twin: KeptTwin) -> list[Block]:
    """Return what a report says of the twin of a project."""
    unit, touching = unit_label(twin.unit), twin.touching
    facts = {
        "Grains": f"{len(twin.avatars)}, {len(twin.cut)} of them cut by the border",
        "Fit": f"misfit {100 * twin.misfits[0]:.2f} % of the contrast before, "
        f"{100 * twin.misfits[-1]:.2f} % after {len(twin.misfits) - 1} sweeps (median over the grains); "
        f"noise {100 * twin.noise:.2f} %",
        "Optics": f"blur {twin.blur:.3g} {unit}, tones {twin.tone_model}, void level {twin.void_model}",
        "Contacts": f"{len(touching)}, and {len(twin.contacts) - len(touching)} near misses",
        "Porosity": f"{100 * twin.porosity.whole:.2f} %; what has no avatar counts as pore",
    }  # fmt: skip
    blocks: list[Block] = [Heading("Twin"), Facts(facts), *(Paragraph(note) for note in twin.notes)]
    if len(touching):
        blocks.append(
            Picture(
                fabric_figure(twin),
                "Where the contacts of the twin point, how many each grain has that the border does not cut, "
                "and the fabric tensors. A pair is a contact if its gap is most probably 0.1 voxel or less.",
            )
        )
    return blocks
