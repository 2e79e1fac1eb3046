#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""A camera with TLS, for live_secure.sh: live_secure.py CERTIFICATE KEY STREAM.ts IMAGE.jpg LOG

Prints its port. https://../cam.mjpg is MJPEG, /video.ts the stream, /away redirects to http; rtsps://../cam is the stream
over RTSP, interleaved. LOG receives the first line of each request.
"""
import socket
import ssl
import struct
import sys
import threading
import time

certificate, key, stream_file, image_file, log_file = sys.argv[1:]
stream = open(stream_file, "rb").read()
image = open(image_file, "rb").read()
context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
context.load_cert_chain(certificate, key)
server = socket.socket()
server.bind(("127.0.0.1", 0))
server.listen(8)
port = server.getsockname()[1]
log = open(log_file, "a", buffering=1)


def packets():
    """MPEG-TS in RTP (RFC 2250), seven TS packets each, interleaved (RFC 2326, 10.12), at about ten times its speed."""
    number = 0
    while True:
        for at in range(0, len(stream) - 1315, 1316):
            rtp = struct.pack(">BBHII", 0x80, 33, number & 0xFFFF, number * 900 & 0xFFFFFFFF, 7)
            rtp += stream[at:at + 1316]
            yield b"$\0" + struct.pack(">H", len(rtp)) + rtp
            number += 1
            time.sleep(0.002)


def rtsp(client, request):
    sdp = b"v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=x\r\nt=0 0\r\nm=video 0 RTP/AVP 33\r\na=control:track\r\n"
    while request:
        method = request.split()[0].decode()
        number = [line for line in request.decode().split("\r\n") if line.lower().startswith("cseq")][0]
        body, extra = b"", ""
        if method == "DESCRIBE":
            body, extra = sdp, "Content-Type: application/sdp\r\nContent-Length: %d\r\n" % len(sdp)
        elif method == "SETUP":
            extra = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
        elif method == "OPTIONS":
            extra = "Public: OPTIONS, DESCRIBE, SETUP, PLAY\r\n"
        else:
            extra = "Session: 1\r\n"
        client.sendall(("RTSP/1.0 200 OK\r\n%s\r\n%s\r\n" % (number, extra)).encode() + body)
        if method == "PLAY":
            for packet in packets():
                client.sendall(packet)
        request = client.recv(65536)


def serve(plain):
    try:
        with context.wrap_socket(plain, server_side=True) as client:
            request = client.recv(65536)
            first = request.split(b"\r\n")[0].decode()
            log.write(first + ("  with password\n" if b"Authorization" in request else "\n"))
            if "RTSP" in first:
                rtsp(client, request)
            elif "/away" in first:
                client.sendall(b"HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:%d/\r\nContent-Length: 0\r\n\r\n" % port)
            elif "/video.ts" in first:
                client.sendall(b"HTTP/1.1 200 OK\r\nContent-Type: video/mp2t\r\nConnection: close\r\n\r\n" + stream)
            else:
                client.sendall(b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=x\r\n\r\n")
                while True:
                    client.sendall(b"--x\r\nContent-Type: image/jpeg\r\n\r\n" + image + b"\r\n")
                    time.sleep(0.02)
    except (OSError, IndexError):
        pass


print(port, flush=True)
while True:
    threading.Thread(target=serve, args=(server.accept()[0],), daemon=True).start()
