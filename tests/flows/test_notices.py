"""What a mail server and Slack get of a run that failed; the way there is tested with the server's."""

from __future__ import annotations

import json
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from email import message_from_bytes, policy
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from queue import Queue

import pytest
from apprise.plugins.slack import NotifySlack
from prefect.blocks.notifications import SlackWebhook

from upplied.errors import SettingsError
from upplied.flows import automations

SUBJECT, BODY = "transfer-fleet: Failed", "nightly: Failed: 0 ok, 0 refused, 2 failed"


class Mailbox(socketserver.StreamRequestHandler):
    """Takes a mail as SMTP has it, after a name and a password."""

    def handle(self) -> None:
        self.say("220 here")
        mail, lines = b"", []
        while line := self.rfile.readline():
            word = line.split()[0].upper()
            lines.append(line.decode().strip())
            if word == b"EHLO":
                self.say("250-here\r\n250 AUTH PLAIN LOGIN")
            elif word == b"AUTH":
                self.say("235 welcome")
            elif word == b"DATA":
                self.say("354 go on")
                while (part := self.rfile.readline()) != b".\r\n":
                    mail += part
                self.say("250 taken")
            elif word == b"QUIT":
                self.say("221 bye")
                break
            else:
                self.say("250 fine")
        self.server.received.put((lines, mail))

    def say(self, text: str) -> None:
        self.wfile.write(f"{text}\r\n".encode())


class Hook(BaseHTTPRequestHandler):
    """Takes what is posted to it, and says what Slack says."""

    def do_POST(self) -> None:
        self.server.received.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b"ok")

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def listening(server: socketserver.TCPServer) -> Iterator[tuple[int, Queue]]:
    """A server in a thread; its port and what it receives."""
    server.received = Queue()
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield server.server_address[1], server.received
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_mail_says_what_failed_to_whom_it_was_told():
    with listening(socketserver.ThreadingTCPServer(("127.0.0.1", 0), Mailbox)) as (port, received):
        address = (
            f"mailto://user:password@127.0.0.1:{port}?to=ops@example.org&from=fleet@example.org&mode=insecure"
        )
        automations._block(address).notify(BODY, SUBJECT)
        lines, mail = received.get(timeout=20)
    assert "rcpt to:<ops@example.org>" in [line.lower() for line in lines]
    assert any(line.startswith("AUTH") for line in lines)
    message = message_from_bytes(mail, policy=policy.default)
    assert message["Subject"] == SUBJECT and "fleet@example.org" in message["From"]
    assert BODY in message.get_body(("plain", "html")).get_content()


def test_slack_says_what_failed(monkeypatch):
    block = automations._block(f"https://hooks.slack.com/services/T0123ABCD/B0123ABCD/{'x' * 24}")
    assert isinstance(block, SlackWebhook)
    with listening(ThreadingHTTPServer(("127.0.0.1", 0), Hook)) as (port, received):
        monkeypatch.setattr(NotifySlack, "webhook_url", f"http://127.0.0.1:{port}/services")
        block.notify(BODY, SUBJECT)
        content = json.dumps(received.get(timeout=20))
    assert BODY in content and SUBJECT in content


@pytest.mark.parametrize("url", ["http://ops.example.org/hook", "https://ops.example.org/hook"])
def test_a_webhook_gets_the_words_apart(url):
    content = automations._block(url).json_data
    assert content == {"text": "{{subject}}\n{{body}}", "subject": "{{subject}}", "body": "{{body}}"}


@pytest.mark.parametrize("url", ["nonsense", "http://", "foo://secret@somewhere", "https://[", "mailto://"])
def test_an_address_that_nothing_can_be_sent_to_is_refused_without_its_password(url):
    with pytest.raises(SettingsError, match="no message can be sent to it") as refused:
        automations._block(url)
    assert "secret" not in str(refused.value)
