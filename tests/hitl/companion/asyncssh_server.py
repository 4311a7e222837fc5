"""An ssh server for machines without sshd: python asyncssh_server.py FOLDER HOME BIN."""

import asyncio
import os
import sys

import asyncssh


async def serve(folder: str, home: str, path: str) -> None:
    """Serves commands and SFTP on port 22.

    Args:
        folder: with host_key and authorized_keys.
        home: HOME of the commands.
        path: the first entry of their PATH.
    """
    environment = {**os.environ, "HOME": home, "PATH": f"{path}:/usr/bin:/bin"}
    for name in ("PYTHONPATH", "XDG_CACHE_HOME", "PYENV_ROOT"):
        environment.pop(name, None)

    async def run(process):
        child = await asyncio.create_subprocess_shell(
            process.command,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env=environment,
            cwd=home,
            start_new_session=True,
        )
        await process.redirect(stdin=child.stdin, stdout=child.stdout, stderr=child.stderr)
        code = await child.wait()
        # What it wrote may still be on its way, and must arrive before the exit code.
        await process.stdout.drain()
        await process.stderr.drain()
        process.exit(code)

    await asyncssh.listen(
        "",
        22,
        server_host_keys=[f"{folder}/host_key"],
        authorized_client_keys=f"{folder}/authorized_keys",
        password_auth=False,
        process_factory=run,
        sftp_factory=True,
        encoding=None,
        allow_scp=False,
    )
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(serve(*sys.argv[1:]))
