"""An OPC UA server that writes what it is told on stdin: lines of JSON, ``[t, {node: value}]``; null
is a value of bad status. Run by the tests as a process that can be killed."""

import asyncio
import json
import sys
from datetime import UTC, datetime

from asyncua import Server, ua


async def main(port: int, names: list[str]) -> None:
    server = Server()
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    space = await server.register_namespace("urn:tests")
    nodes = {
        name: await server.nodes.objects.add_variable(ua.NodeId(name, space), name, 0.0)
        for name in names
    }
    loop = asyncio.get_running_loop()
    async with server:
        print("ready", flush=True)
        while line := await loop.run_in_executor(None, sys.stdin.readline):
            for time, values in json.loads(line):
                stamp = datetime.fromtimestamp(time, UTC)
                for name, value in values.items():
                    good = ua.StatusCodes.Good if value is not None else ua.StatusCodes.Bad
                    variant = ua.Variant() if value is None else ua.Variant(value)
                    told = ua.DataValue(variant, ua.StatusCode(good), stamp, stamp)
                    await nodes[name].write_value(told)
            print("done", flush=True)


asyncio.run(main(int(sys.argv[1]), sys.argv[2:]))
