"""How a system wants to be stepped, as annotations of an SSD: for us, for libcosim and for OMSimulator."""

from __future__ import annotations

from lxml import etree

from cobot_joint.system.model import DefaultExperiment
from cobot_joint.system.osp import STEP
from cobot_joint.system.read import COUPLING, NS

OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
PREFIXES = {
    "osp": OSP,
    "oms": OMS,
}  # declared at the root: libcosim looks for this very prefix, and takes no attribute there
TOLERANCE = "0.0001"  # OMSimulator's own default


def annotate_system(system: etree._Element, experiment: DefaultExperiment) -> None:
    """OMSimulator opens no system without its master algorithm."""
    inside = _annotation(system, "org.openmodelica")
    root = etree.SubElement(inside, f"{{{OMS}}}Annotations")
    information = etree.SubElement(root, f"{{{OMS}}}SimulationInformation")
    etree.SubElement(
        information, f"{{{OMS}}}FixedStepMaster", description="oms-ma", stepSize=f"{experiment.step or STEP:.6f}",
        absoluteTolerance=TOLERANCE, relativeTolerance=TOLERANCE,
    )  # fmt: skip


def annotate_experiment(node: etree._Element, experiment: DefaultExperiment) -> None:
    """libcosim's base step; our scheme and step where the system says them."""
    inside = _annotation(node, "com.opensimulationplatform")
    algorithm = etree.SubElement(inside, f"{{{OSP}}}Algorithm")
    etree.SubElement(algorithm, f"{{{OSP}}}FixedStepAlgorithm", baseStepSize=repr(experiment.step or STEP))
    coupling = {"scheme": experiment.scheme, "step": repr(float(experiment.step)) if experiment.step else None}
    if given := {name: value for name, value in coupling.items() if value is not None}:
        etree.SubElement(_annotation(node, COUPLING), "coupling", given)


def _annotation(parent: etree._Element, kind: str) -> etree._Element:
    group = parent.find("ssd:Annotations", NS)
    if group is None:
        group = etree.SubElement(parent, f"{{{NS['ssd']}}}Annotations")
    return etree.SubElement(group, f"{{{NS['ssc']}}}Annotation", type=kind)
