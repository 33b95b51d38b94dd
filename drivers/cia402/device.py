"""A CiA 402 drive on the bus: object dictionary and state machine on one side, one axis of a bank on the other.

With every SYNC: RPDOs into the dictionary, controlword, set point to the loops; then TPDOs sample. The state machine
obeys the table of states.py; ramps and reactions are those of the option codes 605Ah … 605Eh and 6007h.
An enabled drive in a cyclic mode lives on fresh set points: it goes on for a period without one, then brakes; ten SYNC periods without
one, or without SYNC, count as loss of communication. Enabling, and whatever else makes it stop, begins from where the axis is.
"""

from __future__ import annotations

from drivers.bus.base import Bus
from drivers.canopen.emcy import EmcyCode
from drivers.canopen.nmt import NmtState
from drivers.canopen.node import CanopenNode, CommunicationLoss, NodeApplication
from drivers.cia402.axis_watch import Alarm
from drivers.cia402.bank import DriveBank
from drivers.cia402.faults import CODE_OF_ALARM, CODE_OF_LOSS, Faults
from drivers.cia402.gate_keeper import GateKeeper
from drivers.cia402.homing import Homing
from drivers.cia402.master_watch import MasterWatch
from drivers.cia402.parameters import AbortConnection, DriveParameters, QuickStop
from drivers.cia402.process_data import LIMITED, ProcessData
from drivers.cia402.states import (
    Command,
    Control,
    Event,
    Mode,
    State,
    Status,
    Transition,
    command_of,
    on_controlword,
    on_event,
    statusword_of,
)
from drivers.clock import Clock
from drivers.objects import DeviceDef, Value
from stack.servo.state import AxisMode

_LOOP = {
    Mode.CYCLIC_POSITION: AxisMode.POSITION,
    Mode.CYCLIC_VELOCITY: AxisMode.VELOCITY,
    Mode.CYCLIC_TORQUE: AxisMode.TORQUE,
}
_POWERED = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE)


class Drive(NodeApplication):
    """One drive: `device` on `bus`, moving axis number `axis` of `bank`. `power_on` boots it."""

    def __init__(self, device: DeviceDef, clock: Clock, bus: Bus, bank: DriveBank, axis: int) -> None:
        self.state = State.NOT_READY
        self.mode = Mode.NONE
        self._loop: AxisMode | None = None
        self.clock = clock
        self.axis = bank.axis(axis, self._on_alarm)
        self.node = CanopenNode(device, clock, bus, self)
        dictionary = self.node.dictionary
        supported = dictionary.integer(0x6502)
        if self.axis.outputs_velocity:  # its plant takes no torque
            supported &= ~(1 << Mode.CYCLIC_TORQUE - 1)
        self.parameters = DriveParameters(dictionary, supported, self._on_limits)
        self.process_data = ProcessData(dictionary, self.axis, self.parameters)
        self.homing = Homing(dictionary, self.axis)
        self.faults = Faults(self.node)
        self.gate = GateKeeper(self.node, self.parameters, clock, lambda: self._follows)
        self._controlword = 0
        self._watch = MasterWatch(self.node, self.axis, self.parameters, clock, self.on_communication_loss)
        self._flags = 0
        self._after_stop: State | None = None
        self._holding = False
        self._enable_locked = False
        self._previous_nmt_state = NmtState.INITIALISING
        dictionary.bind(0x6040, sink=self._on_controlword)
        dictionary.bind(0x6060, sink=self._on_mode)
        dictionary.bind(0x6061, source=lambda: int(self.mode))
        dictionary.bind(0x6041, source=self.statusword)
        dictionary.bind(0x603F, source=self.faults.error_code)
        dictionary.bind(0x6502, source=lambda: supported)

    def power_on(self) -> None:
        """Boots the node; the axis stays without torque until it is enabled."""
        self.node.power_on()

    def power_off(self) -> None:
        """Pulls the plug: no torque, no frame."""
        self.node.power_off()
        self._switch_off(State.NOT_READY)
        self._previous_nmt_state = NmtState.INITIALISING

    def trip(self) -> None:
        """The power stage has switched itself off: too much current. FAULT without a ramp."""
        self._fault(EmcyCode.OVER_CURRENT, at_once=True)

    # ---- what comes from the network

    def on_reset(self, whole: bool) -> None:
        self._controlword = 0
        self._enable_locked = False
        self.faults.forget()
        self.parameters.refresh()
        self._on_limits()
        self._on_mode(self.node.dictionary.get(0x6060))

    def on_nmt_state(self, state: NmtState) -> None:
        previous, self._previous_nmt_state = self._previous_nmt_state, state
        if state is NmtState.INITIALISING:
            self._start_over()
        elif previous is NmtState.INITIALISING:
            if self._after_stop is None:
                self._move(on_event(self.state, Event.INITIALISED))
        elif previous is NmtState.OPERATIONAL or state is NmtState.STOPPED:
            self.on_communication_loss(CommunicationLoss.NMT)

    def on_communication_loss(self, loss: CommunicationLoss) -> None:
        """Reaction of 6007h, if the drive is enabled."""
        if self.state is not State.OPERATION_ENABLED:
            return
        code = CODE_OF_LOSS[loss]
        if loss is not CommunicationLoss.NMT:
            self.node.emcy.report(code)
        option = self.parameters.abort_connection
        if option is AbortConnection.FAULT:
            self._fault(code)
        elif option is AbortConnection.DISABLE_VOLTAGE:
            self._switch_off(State.SWITCH_ON_DISABLED)
        elif option is AbortConnection.QUICK_STOP:
            self._enable_locked = True
            self._quick_stop()
        elif not self._holding:
            self._holding = True
            self._seed_gate()
            self.axis.expect_sync(None)
            self.axis.stop(self.parameters.deceleration, report=False)

    @property
    def _follows(self) -> bool:
        """Set points move the axis; where it holds for want of them, the next one will."""
        return self.state is State.OPERATION_ENABLED and self._loop is not None

    def _seed_gate(self) -> None:
        """The next set point is measured against where the axis is."""
        self.gate.seed(self.process_data.position() if self.mode is Mode.CYCLIC_POSITION else 0)

    def on_sync(self, counter: int | None) -> None:
        self.gate.on_sync()
        fresh = self.process_data.take_fresh()
        self._flags = self.axis.take_flags()
        if self.node.emcy.errors:
            self.faults.recovered(fresh)
        if self.state is not State.OPERATION_ENABLED or self._loop is None:
            return
        if self._after_stop is not None or (self._holding and not fresh):
            self._seed_gate()
        if fresh:
            self._watch.missing = 0
            if self._holding:
                self._resume()
            self.process_data.pass_on(self.clock.now_ns(), self.parameters.period_ns)
        elif not self._holding:
            self._watch.on_missing()
        if self.state is State.OPERATION_ENABLED and not self._holding:
            self._watch.on_sync()

    # ---- controlword

    def _on_controlword(self, value: Value) -> None:
        """Called when the whole RPDO is in."""
        controlword = int(value)
        previous, self._controlword = self._controlword, controlword
        if controlword == previous and self.state is State.OPERATION_ENABLED and self._after_stop is None:
            return
        if self.state is State.FAULT:
            if controlword & ~previous & Control.FAULT_RESET:
                self._reset_fault()
            return
        self._obey(controlword)
        if self.state is State.OPERATION_ENABLED:
            if self.mode is Mode.HOMING:
                self.homing.on_controlword(controlword, previous)
            if (controlword ^ previous) & Control.HALT and self._after_stop is None:
                self._resume()

    def _obey(self, controlword: int) -> None:
        command = command_of(controlword)
        if self._enable_locked:
            # a master that has come back must say something else than «enable» before an aborted motion goes on
            if command is Command.ENABLE_OPERATION:
                return
            self._enable_locked = False
        if self.state is State.OPERATION_ENABLED and command is Command.ENABLE_OPERATION:
            if self._after_stop is not None:
                self._resume()
            return
        transition = on_controlword(self.state, controlword)
        while transition is not None and self._move(transition):
            transition = on_controlword(self.state, controlword)

    def _move(self, transition: Transition | None) -> bool:
        """Does what a transition asks for. False: the state stays, for now (a ramp comes first)."""
        if transition is None:
            return False
        number, target = transition
        if number in (5, 8) and self.parameters.option(0x605C if number == 5 else 0x605B) == 1:
            if self._after_stop is None:
                self.axis.stop(self.parameters.deceleration, report=True)
            self._after_stop = target
            return False
        if number == 11:
            self._quick_stop()
        elif target is State.OPERATION_ENABLED:
            self._enable()
        elif target in _POWERED or self.state not in _POWERED:
            self.state = target
        else:
            self._switch_off(target)
        return True

    # ---- what the axis does

    def _enable(self) -> None:
        self.state = State.OPERATION_ENABLED
        self.process_data.seed()
        self._seed_gate()
        self._watch.begin(cyclic=self._loop is not None)
        self._resume()

    def _resume(self) -> None:
        """The axis follows its set points, or holds: halted, no cyclic mode."""
        self._after_stop = None
        self._holding = False
        if self._controlword & Control.HALT:
            quick = self.parameters.option(0x605D) == 2
            ramp = self.parameters.quick_stop_deceleration if quick else self.parameters.deceleration
            self.axis.stop(ramp, report=False)
        elif self._loop is None:
            self.axis.stop(self.parameters.deceleration, report=False)
        else:
            self.axis.run(self._loop, self.parameters.quick_stop_deceleration)

    def _quick_stop(self) -> None:
        option = self.parameters.quick_stop
        if option is QuickStop.DISABLE:
            self._switch_off(State.SWITCH_ON_DISABLED)
            return
        stays = option in (QuickStop.SLOW_DOWN_AND_STAY, QuickStop.QUICK_STOP_RAMP_AND_STAY)
        slow = option in (QuickStop.SLOW_DOWN, QuickStop.SLOW_DOWN_AND_STAY)
        self.state = State.QUICK_STOP_ACTIVE
        self._brake(slow, None if stays else State.SWITCH_ON_DISABLED)

    def _brake(self, slow: bool, after: State | None) -> None:
        self.axis.expect_sync(None)
        self._after_stop = after
        ramp = self.parameters.deceleration if slow else self.parameters.quick_stop_deceleration
        self.axis.stop(ramp, report=after is not None)

    def _switch_off(self, state: State) -> None:
        self.state = state
        self._after_stop = None
        self._holding = False
        self.axis.off()

    def _start_over(self) -> None:
        """Reset. An axis in motion is braked before it loses its torque; until then the drive is not ready."""
        moving = self.state in _POWERED
        self.state = State.NOT_READY
        if moving:
            self._brake(slow=False, after=State.SWITCH_ON_DISABLED)
        else:
            self._switch_off(State.NOT_READY)

    # ---- faults

    def _on_alarm(self, alarm: Alarm) -> None:
        helpless = self.state is State.FAULT_REACTION_ACTIVE  # the ramp has been tried, and the axis does not obey
        for bit, code in CODE_OF_ALARM.items():
            if alarm & bit:
                self._fault(code, at_once=bit is Alarm.SENSOR or helpless)  # no ramp without an encoder either
        if alarm & Alarm.SYNC_LOST:
            self._watch.on_late_sync()
        if alarm & Alarm.STOPPED and self._after_stop is not None:
            self._switch_off(self._after_stop)

    def _fault(self, code: EmcyCode, at_once: bool = False) -> None:
        """Transition 13 with the reaction of 605Eh, then 14; `at_once`: no ramp, torque off."""
        if self.state is State.FAULT or (self.state is State.FAULT_REACTION_ACTIVE and not at_once):
            return
        powered = self.state in _POWERED or self._after_stop is not None
        self.faults.note(code)
        option = self.parameters.option(0x605E)
        if powered and option != 0 and not at_once:
            self.axis.forgive()
            if code is EmcyCode.FOLLOWING_ERROR:
                self.axis.seed()  # the set point is where the axis could not get to
            self.state = State.FAULT_REACTION_ACTIVE
            self._brake(slow=option == 1, after=State.FAULT)
        else:
            self._switch_off(State.FAULT)

    def _reset_fault(self) -> None:
        """Transition 15, unless what caused the fault is still there."""
        if self.faults.clear():
            self._move(on_event(self.state, Event.FAULT_RESET))

    # ---- objects

    def statusword(self) -> int:
        """6041h as it is now."""
        return statusword_of(self.state, Status.VOLTAGE_ENABLED | Status.REMOTE | self._status_bits())

    def _status_bits(self) -> int:
        bits = Status.INTERNAL_LIMIT if self._flags & LIMITED else 0
        if self.faults.following_error:
            bits |= Status.FOLLOWING_ERROR
        if self.state is not State.OPERATION_ENABLED:
            standing = self.state is State.QUICK_STOP_ACTIVE and self.process_data.standing
            return bits | (Status.TARGET_REACHED if standing else 0)
        if self._watch.missing:
            bits |= Status.WARNING
        if self.mode is Mode.HOMING:
            return bits | self.homing.status
        if self._after_stop is not None or self._holding or self._controlword & Control.HALT:
            return bits | (Status.TARGET_REACHED if self.process_data.standing else 0)
        if self._loop is not None and self._watch.follows:
            bits |= Status.FOLLOWS_TARGET
            if self.process_data.target_reached():
                bits |= Status.TARGET_REACHED
        return bits

    def _on_limits(self) -> None:
        self.axis.limit(self.parameters.limits)

    def _on_mode(self, value: Value) -> None:
        mode = Mode(int(value))
        if mode is self.mode:  # a master may have 6060h in its RPDO
            return
        self.mode = mode
        self._loop = _LOOP.get(self.mode)
        self.homing.reset()
        self.process_data.set_mode(self.mode)
        if self.state is State.OPERATION_ENABLED and self._after_stop is None:
            self._enable()
