"""The autonomy's end of a race, before there is one."""

from airrace.hitl.autonomy_process import AutonomyProcess
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import Endpoint
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.scenario import Scenario


def test_it_says_that_it_compiles(tmp_path):
    link, said = SimulatedLink(LinkConfig()), []
    process = AutonomyProcess(Scenario(), link.bus(), tmp_path, said.append, clock=link.clock)
    simulation = Endpoint("simulation", [], link.bus(), link.clock)
    for count in range(1, 201):  # a function every 100 ms
        link.time += 0.1
        simulation.send_heartbeat(phases.WAITING, 0.0)
        process.show_compiling(count)
        simulation.drain()
    assert simulation.peer_heartbeat.value.phase == phases.COMPILING
    assert simulation.silence == 0.0
    assert 3 <= len(said) <= 5 and said[-1].startswith("airrace: compiling, once; ")
