# SPDX-License-Identifier: MIT
"""Queries of the window tests to the X server: lib_x11.py COMMAND. Needs libX11 and libXfixes only.

geometry TITLE   x y width height of the top-level window of that title; exit status 1 if there is none
cursor           number of visible pixels of the pointer at its present place
mean             mean of red, green, blue of the whole screen
mean X Y W H     the same of a part
hash X Y W H     a number that changes with the image
stable SECONDS PID X Y W H HASH..
                 the hash, once three looks give the same hash that is none of those; exit status 1 if PID ends or after
                 SECONDS
wait-window SECONDS PID TITLE
                 until that window exists; the same exit status
wait-image SECONDS PID X Y W H
                 until that part is not black
save FILE        the screen as PPM
close TITLE      asks the window to close, as its close button does
"""
import ctypes as c
import os
import sys
import time
import zlib

x11 = c.CDLL("libX11.so.6")
x11.XOpenDisplay.restype = c.c_void_p
display = c.c_void_p(x11.XOpenDisplay(None))
if not display:
    sys.exit("no display")
x11.XDefaultRootWindow.restype = c.c_ulong
root = c.c_ulong(x11.XDefaultRootWindow(display))
width, height = x11.XDisplayWidth(display, 0), x11.XDisplayHeight(display, 0)


class XImage(c.Structure):
    _fields_ = [("width", c.c_int), ("height", c.c_int), ("xoffset", c.c_int), ("format", c.c_int),
                ("data", c.POINTER(c.c_ubyte)), ("byte_order", c.c_int), ("bitmap_unit", c.c_int),
                ("bitmap_bit_order", c.c_int), ("bitmap_pad", c.c_int), ("depth", c.c_int),
                ("bytes_per_line", c.c_int), ("bits_per_pixel", c.c_int)]


class CursorImage(c.Structure):
    _fields_ = [("x", c.c_short), ("y", c.c_short), ("width", c.c_ushort), ("height", c.c_ushort),
                ("xhot", c.c_ushort), ("yhot", c.c_ushort), ("serial", c.c_ulong),
                ("pixels", c.POINTER(c.c_ulong))]


class Attributes(c.Structure):
    _fields_ = [("x", c.c_int), ("y", c.c_int), ("width", c.c_int), ("height", c.c_int),
                ("rest", c.c_char * 256)]


def pixels(x, y, w, h):
    x11.XGetImage.restype = c.POINTER(XImage)
    image = x11.XGetImage(display, root, x, y, w, h, c.c_ulong(0xFFFFFFFF), 2).contents
    assert image.bits_per_pixel == 32
    raw = c.string_at(image.data, image.bytes_per_line * h)
    return raw  # blue, green, red, unused


def area():
    numbers = [int(word) for word in sys.argv[2:6]]
    return numbers if len(numbers) == 4 else [0, 0, width, height]


def children(window):
    top, parent, count = c.c_ulong(), c.c_ulong(), c.c_uint()
    found = c.POINTER(c.c_ulong)()
    x11.XQueryTree(display, window, c.byref(top), c.byref(parent), c.byref(found), c.byref(count))
    return [c.c_ulong(found[i]) for i in range(count.value)]


def title(window):
    name = c.c_char_p()
    x11.XFetchName(display, window, c.byref(name))
    return (name.value or b"").decode("utf-8", "replace")


def wait(observe):
    """Repeats observe() until it returns something, which is returned. Pauses between calls, since a drawing program needs the time
    too."""
    deadline = time.monotonic() + float(sys.argv[2])
    while time.monotonic() < deadline and os.path.exists(f"/proc/{sys.argv[3]}"):
        found = observe()
        if found is not None:
            return found
        time.sleep(0.05)
    sys.exit(1)


def stable():
    """For wait(): a hash that three calls in a row agree on."""
    seen = []
    known = set(sys.argv[8:])

    def observe():
        seen.append(str(zlib.crc32(pixels(*(int(word) for word in sys.argv[4:8])))))
        return seen[-1] if seen[-1] not in known and len(seen) > 2 and len(set(seen[-3:])) == 1 else None

    return observe


command = sys.argv[1]
if command == "stable":
    print(wait(stable()))
elif command == "wait-window":
    wait(lambda: next((window for window in children(root) if sys.argv[4] in title(window)), None))
elif command == "wait-image":
    def has_light():
        raw = pixels(*(int(word) for word in sys.argv[4:8]))
        return any(raw[0::4]) or any(raw[1::4]) or any(raw[2::4]) or None

    wait(has_light)
elif command == "geometry":
    for window in children(root):
        if sys.argv[2] in title(window):
            at = Attributes()
            x11.XGetWindowAttributes(display, window, c.byref(at))
            print(at.x, at.y, at.width, at.height)
            sys.exit(0)
    sys.exit(1)
elif command == "close":
    class Message(c.Structure):
        _fields_ = [("type", c.c_int), ("serial", c.c_ulong), ("send_event", c.c_int), ("display", c.c_void_p),
                    ("window", c.c_ulong), ("message_type", c.c_ulong), ("format", c.c_int),
                    ("data", c.c_long * 5), ("rest", c.c_char * 192)]
    x11.XInternAtom.restype = c.c_ulong
    atom = {name: x11.XInternAtom(display, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW")}
    for window in children(root):
        if sys.argv[2] in title(window):
            message = Message(type=33, window=window.value, message_type=atom[b"WM_PROTOCOLS"], format=32)
            message.data[0] = atom[b"WM_DELETE_WINDOW"]
            x11.XSendEvent(display, window, 0, c.c_long(0), c.byref(message))
            x11.XSync(display, 0)
elif command == "cursor":
    fixes = c.CDLL("libXfixes.so.3")
    event, error = c.c_int(), c.c_int()
    fixes.XFixesQueryExtension(display, c.byref(event), c.byref(error))
    fixes.XFixesGetCursorImage.restype = c.POINTER(CursorImage)
    cursor = fixes.XFixesGetCursorImage(display).contents
    print(sum(1 for i in range(cursor.width * cursor.height) if cursor.pixels[i] >> 24 & 255))
elif command == "mean":
    raw = pixels(*area())
    count = len(raw) // 4
    print(*(sum(raw[channel::4]) // count for channel in (2, 1, 0)))
elif command == "hash":
    print(zlib.crc32(pixels(*area())))
elif command == "save":
    raw = pixels(0, 0, width, height)
    rgb = bytearray(width * height * 3)
    rgb[0::3], rgb[1::3], rgb[2::3] = raw[2::4], raw[1::4], raw[0::4]
    with open(sys.argv[2], "wb") as file:
        file.write(b"P6 %d %d 255\n" % (width, height) + rgb)
