"""The page's files as they lie in their folder: changed, added, removed, and no others."""

from __future__ import annotations

import asyncio
from pathlib import Path

from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from bicycle_cockpit.assets import Assets


def test_a_folder_is_served_as_it_is_now(tmp_path: Path) -> None:
    folder = tmp_path / "web"
    (folder / "scene").mkdir(parents=True)
    (folder / "main.js").write_text("first")
    (folder / "scene" / "world.js").write_text("world " * 100)
    (tmp_path / "secret.js").write_text("secret")
    assets = Assets(folder)
    assets.read_all()

    async def answer(request: web.Request) -> web.Response:
        return assets.response(request, request.match_info["name"])

    async def story() -> None:
        app = web.Application()
        app.router.add_get("/{name:.+}", answer)
        async with TestClient(TestServer(app)) as client:

            async def got(name: str) -> str | int:
                async with client.get(f"/{name}") as response:
                    return await response.text() if response.status == 200 else response.status

            assert await got("main.js") == "first"
            assert await got("scene/world.js") == "world " * 100
            assert await got("later.js") == 404
            for name in ("scene", "%2e%2e%2fsecret.js", "scene%2f..%2f..%2fsecret.js"):
                assert await got(name) == 404, name
            (folder / "main.js").write_text("second, and longer")
            (folder / "later.js").write_text("later")
            assert await got("main.js") == "second, and longer"
            assert await got("later.js") == "later"
            (folder / "later.js").unlink()
            assert await got("later.js") == 404

    asyncio.run(story())
