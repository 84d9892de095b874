"""A service that answers what a test tells it to."""

import concurrent.futures
import re
import threading

import grpc
import numpy as np

from teletact.v1 import common_pb2 as common
from teletact.v1 import elastography_pb2_grpc as elastography_grpc
from teletact.v1 import palpation_pb2 as palpation
from teletact.v1 import palpation_pb2_grpc as palpation_grpc


class Liar(palpation_grpc.PalpationServicer, elastography_grpc.ElastographyServicer):
    """Answers what a test tells it to."""

    def __init__(self):
        self.scene = palpation.Scene()
        self.estimate = []
        self.touch = lambda requests, context: iter(())
        self.observe = lambda requests, context: iter(())
        self.over = threading.Event()  # of the newest touch

    def ListScenes(self, request, context):
        return palpation.ListScenesResponse()

    def GetScene(self, request, context):
        return self.scene

    def Estimate(self, requests, context):
        for _ in requests:
            pass
        yield from self.estimate

    def Observe(self, requests, context):
        yield from self.observe(requests, context)

    def Touch(self, requests, context):
        context.add_callback(self.over.set)
        yield from self.touch(requests, context)

    def serve(self, address):
        """A server, which has started; who calls stops it. Port 0: any that is free."""
        server = grpc.server(concurrent.futures.ThreadPoolExecutor(8))
        palpation_grpc.add_PalpationServicer_to_server(self, server)
        elastography_grpc.add_ElastographyServicer_to_server(self, server)
        port = server.add_insecure_port(address)
        self.address = re.sub(":0$", f":{port}", address)
        server.start()
        return server


def a_map(name, values, dtype=common.DATA_TYPE_FLOAT32, unit="Pa"):
    height, width = np.shape(values)
    out = common.Map(name=name, unit=unit)
    out.grid.size.extend([width, height])
    out.grid.origin_m.extend([0.0, 0.0])
    out.grid.spacing_m.extend([0.001, 0.001])
    out.values.dtype = dtype
    out.values.shape.extend([height, width])
    out.values.data = np.asarray(values, "u1" if dtype == common.DATA_TYPE_UINT8 else "<f4").tobytes()
    return out


def opened(**changes):
    out = palpation.TouchOpened(period_s=0.002, credit=2, instance=5)
    out.covered.end_x_m = 0.1
    for name, value in changes.items():
        setattr(out, name, value)
    return palpation.TouchResponse(opened=out)


def answer_to(request, number, **changes):
    out = palpation.TouchAnswer(answer=number, sequence=request.pose.sequence, status=palpation.TOUCH_STATUS_OK,
                                position_m=request.pose.position_m, force_n=[0.0, -0.1, 0.0], tangent_n_m=[0.0] * 9)
    out.covered.end_x_m = 0.1
    for name, value in changes.items():
        if isinstance(value, list):
            del getattr(out, name)[:]
            getattr(out, name).extend(value)
        else:
            setattr(out, name, value)
    return palpation.TouchResponse(answer=out)


def lying(*makers):
    """A touch that is opened well; then each pose is answered by the next of these, the last one again and again."""
    def touch(requests, context):
        next(requests)
        yield opened()
        for number, request in enumerate(requests, 1):
            yield from makers[min(number, len(makers)) - 1](request, number)

    return touch
