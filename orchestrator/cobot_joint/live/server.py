"""A page for this machine and this user alone: on the loopback address, behind a token that its address carries."""

from __future__ import annotations

import logging
import secrets
from typing import Any

from cobot_joint.errors import UserError
from cobot_joint.files import what_is_missing

HOST = "127.0.0.1"
COOKIE = "cobot_joint_token"


class Server:
    """Serves a Dash application. port: 0 takes a free one. UserError: the port is taken."""

    def __init__(self, app: Any, port: int = 0) -> None:
        from werkzeug.serving import make_server

        self.token = secrets.token_urlsafe(24)
        guard(app.server, self.token)
        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        try:
            self._server = make_server(HOST, port, app.server, threaded=True)
        except (OSError, SystemExit) as error:  # SystemExit: werkzeug's way to say that a port is taken
            why = what_is_missing(error) if isinstance(error, OSError) else "it is taken"
            raise UserError(f"--port {port} is given, it cannot be used: {why}; 0 takes a free one") from error

    @property
    def address(self) -> str:
        """Where the page is; it says the token."""
        return f"http://{HOST}:{self._server.server_port}/?token={self.token}"

    def serve(self) -> None:
        """Until it is closed, or interrupted."""
        self._server.serve_forever()

    def close(self) -> None:
        """End `serve`."""
        self._server.shutdown()
        self._server.server_close()


def guard(flask: Any, token: str) -> None:
    """Answer only who asks this very host (a page elsewhere may have its name point here) and knows the token."""
    from flask import Response, request

    def allowed() -> Response | None:
        host = request.host.rpartition(":")[0] or request.host
        given = request.args.get("token") or request.cookies.get(COOKIE) or ""
        if host in (HOST, "localhost") and secrets.compare_digest(given.encode(), token.encode()):
            return None
        return Response("Open the address that cobot-joint printed: it carries a token.\n", 403, mimetype="text/plain")

    def remember(response: Response) -> Response:
        if request.args.get("token") and response.status_code < 400:
            response.set_cookie(COOKIE, token, httponly=True, samesite="Strict")
        return response

    flask.before_request(allowed)
    flask.after_request(remember)
