# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Objects of one drive by SDO, in steps that never block: each waits for the next sample."""

from __future__ import annotations

from collections.abc import Callable, Generator

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.canopen_network import ALL_ANSWER
from spm_haptic_master.encoders.node_setup import Key
from spm_haptic_master.exceptions import SetupError

# Longest wait for the answer to a request (s), and number of requests.
ANSWER_TIMEOUT = 0.2
REQUESTS = 3


class SdoClient:
    """
    Requests to one drive, and its answers.

    Parameters
    ----------
    node_id : int
        CANopen node id of the drive.
    name : str
        Name of the drive in texts.
    send : callable
        Sends one frame.

    Attributes
    ----------
    now : float
        Time of the present sample, s; the caller sets it before each step.

    """

    def __init__(
        self,
        node_id: int,
        name: str,
        send: Callable[[can.Message], None],
    ):
        self.now = 0.0
        self._node_id = node_id
        self._name = name
        self._send = send
        # Requests about an object so far, and the answers since the latest one.
        self._requests = 0
        self._answers: list[bytes] = []

    def on_answer(self, data: bytearray) -> None:
        """Keep an answer to the latest request."""
        self._answers.append(bytes(data))

    def read(self, key: Key) -> Generator[None, None, int | None]:
        """
        Return the value of an object by SDO upload.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.

        Yields
        ------
        None
            Once a sample, until the answer is there.

        Returns
        -------
        int or None
            The value; None if the drive does not give it.

        Raises
        ------
        SetupError
            The drive does not answer.

        """
        answer = yield from self._request(canopen.sdo_upload(self._node_id, *key), key)
        return canopen.sdo_value(answer)

    def write(
        self,
        key: Key,
        value: int,
        size: int,
    ) -> Generator[None, None, bool]:
        """
        Write an object by SDO download.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.
        value : int
            Unsigned value.
        size : int
            Size of the object, bytes.

        Yields
        ------
        None
            Once a sample, until the answer is there.

        Returns
        -------
        bool
            Whether the drive has accepted it.

        Raises
        ------
        SetupError
            The drive does not answer.

        """
        request = canopen.sdo_write(self._node_id, *key, value, size)
        answer = yield from self._request(request, key)
        return answer[0] == canopen.SDO_DOWNLOAD_ANSWER

    def read_alone(self, key: Key) -> Generator[None, None, int | None]:
        """
        Return the value of an object as `read`, and refuse a node id that several devices have.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.

        Yields
        ------
        None
            Once a sample, also for ALL_ANSWER after the answer.

        Returns
        -------
        int or None
            The value; None if the drive does not give it.

        Raises
        ------
        SetupError
            The drive does not answer, or there are more answers than requests.

        """
        value = yield from self.read(key)
        until = self.now + ALL_ANSWER
        while self.now < until:
            yield
        if len(self._answers_about(key)) > self._requests:
            raise SetupError(f'{self._name}: {canopen.shared_node_id(self._node_id, devices=2)}')
        return value

    def _answers_about(self, key: Key) -> list[bytes]:
        """Return the answers about an object since the latest request."""
        return [answer for answer in self._answers if canopen.sdo_object(answer) == key]

    def _request(self, message: can.Message, key: Key) -> Generator[None, None, bytes]:
        """
        Return the answer to a request about an object; SetupError if none comes.

        Each of REQUESTS attempts waits for ANSWER_TIMEOUT, and answers about another object are
        ignored.
        """
        for number in range(1, REQUESTS + 1):
            self._requests = number
            self._answers = []
            self._send(message)
            until = self.now + ANSWER_TIMEOUT
            while self.now < until:
                yield
                answers = self._answers_about(key)
                if answers:
                    return answers[0]
        raise SetupError(f'{self._name} does not answer SDO {canopen.object_name(*key)}')
