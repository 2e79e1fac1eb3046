#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""run.py [--program build/release/bin/tarsier] [--data DIR] [--out DIR] [--only AREA,..] [--npm DIR]

Runs other programs and Tarsier on the same files and prints one table (markdown; with --out also peers.md and
peers.json). Each row names the program's version. A peer that is not installed gives one line that says how to install it.
Rows of --only: sfm, dense, markers, planar, people, landmarks, posit, plates.

Debian: apt-get install python3-opencv python3-numpy colmap libapriltag-dev libdlib-dev libdlib-data
        cmake --build build/release --target tarsier_peers     (the programs that run AprilTag and dlib)
npm:    npm install --ignore-scripts --prefix build/peers @vladmandic/face-api@1.7.15 @mediapipe/face_mesh@0.4.1633559619
        (the second runs in Chromium: apt-get install nodejs npm chromium)
Data:   scripts/get-data.sh list names the public sets. DIR holds them under the names in `needs` below. No data is
        copied into the source tree. Tarsier's own `eval` evaluates all methods alike for markers, image targets, landmarks,
        sfm models and poses.
Times are processor time. Other work on the machine changes them little, but not at all: caches are shared.
"""
import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time

try:
    import numpy as np
    import cv2
except ImportError:
    # Debian's modules work only with Debian's own Python.
    if sys.executable != "/usr/bin/python3" and os.path.exists("/usr/bin/python3") and not os.environ.get("PEERS_AGAIN"):
        os.environ["PEERS_AGAIN"] = "1"
        os.execv("/usr/bin/python3", ["/usr/bin/python3", os.path.abspath(__file__), *sys.argv[1:]])
    np = cv2 = None

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
Z = 1.959964

# Figures of programs that do not run here. They come with the development data, were measured once by others on a similar machine, and are
# reported unchanged.
REFERENCES = [
    ("plates", "plates-eu (37 images)", "OpenALPR 2.3, country eu; with the best pattern", "whole plate right: 27; 30 of 37; 33 among ten", "36 ms"),
    ("plates", "plates-es (24)", "OpenALPR 2.3, Spanish pattern", "found 19, whole plate right 13 of 24", "75 ms"),
    ("plates", "plates-es-small (11)", "OpenALPR 2.3, Spanish pattern", "found 3, whole plate right 3 of 11", ""),
    ("plates", "plates-book (12)", "OpenALPR 2.3, Spanish pattern", "whole plate right 11 of 12", "98 ms"),
    ("plates", "427 frames, 110 of them plates-ro", "OpenALPR 2.3", "found 0.50", ""),
    ("sfm", "sfm-fountain-P11", "COLMAP 4.1.1, camera known", "11 of 11, centres 2.83 mm, AUC at 1 degree 94.2, track 4.75", "88 CPU s"),
]


# The measured versions. The next version of the face mesh (0.4.1657299874) fails with an error in its own graph.
NPM = {"@vladmandic/face-api": "1.7.15", "@mediapipe/face_mesh": "0.4.1633559619"}


class Skip(Exception):
    """A missing peer or data set, and what to do about it."""


def wilson(hits, trials):
    if trials == 0:
        return 0.0, 1.0
    p, s = hits / trials, Z * Z / trials
    middle, half = (p + s / 2) / (1 + s), Z * math.sqrt(p * (1 - p) / trials + s / (4 * trials)) / (1 + s)
    return max(0.0, middle - half), min(1.0, middle + half)


def share_text(hits, trials):
    low, high = wilson(hits, trials)
    return f"{hits / max(1, trials):.3f} ({hits} of {trials}; {low:.2f} to {high:.2f})"


def number(value, digits):
    return "-" if value is None else f"{value:.{digits}f}"


def processor():
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            found = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    except OSError:
        found = []
    import platform
    return f"{found[0] if found else platform.machine()}, {os.cpu_count()} cores"


def debian_version(package):
    done = subprocess.run(["dpkg-query", "-W", "-f=${Version}", package], capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown version"


class Bench:
    def __init__(self, flags, work):
        self.flags = flags
        self.work = work
        self.rows = []
        self.program = flags.program

    def needs(self, name):
        path = os.path.join(self.flags.data, name)
        if not os.path.exists(path):
            raise Skip(f"no {name} in {self.flags.data}: scripts/get-data.sh list")
        return path

    def peer(self, name, packages):
        path = os.path.join(os.path.dirname(self.program), name)
        if not os.access(path, os.X_OK):
            raise Skip(f"not built: apt-get install {packages}; cmake --build .. --target tarsier_peers (programs are looked for beside {self.program})")
        return path

    def package(self, name):
        """The folder of an npm package, and its version."""
        if not shutil.which("node"):
            raise Skip("apt-get install nodejs npm")
        folder = os.path.join(self.flags.npm, "node_modules", *name.split("/"))
        try:
            with open(os.path.join(folder, "package.json"), encoding="utf-8") as file:
                return folder, json.load(file)["version"]
        except OSError:
            raise Skip(f"npm install --ignore-scripts --prefix {self.flags.npm} {name}@{NPM[name]}") from None

    def opencv(self, part=None):
        if cv2 is None:
            raise Skip("apt-get install python3-opencv python3-numpy")
        if part and not hasattr(cv2, part):
            raise Skip(f"this python3-opencv is without cv2.{part}")
        return f"OpenCV {cv2.__version__}"

    def folder(self, *parts):
        path = os.path.join(self.work, *parts)
        os.makedirs(path, exist_ok=True)
        return path

    def add(self, area, files, method, result, cost, figures=None, state="measured"):
        self.rows.append({"area": area, "files": files, "method": method, "result": result, "cost": cost, "state": state,
                          "figures": figures or {}})
        print(f"{area}: {method} on {files}: {result} {cost}", file=sys.stderr, flush=True)

    def skipped(self, area, method, why):
        self.rows.append({"area": area, "files": "", "method": method, "result": "skipped: " + str(why), "cost": "", "state": "skipped",
                          "figures": {}})
        print(f"{area}: {method}: skipped: {why}", file=sys.stderr, flush=True)

    def attempt(self, area, method, work, *words):
        try:
            work(*words)
        except Skip as why:
            self.skipped(area, method, why)
        except subprocess.CalledProcessError as error:
            last = (error.stderr or "").strip().splitlines()[-1:] or [""]
            self.skipped(area, method, f"{os.path.basename(str(error.cmd[0]))} ended with {error.returncode}: {last[0]}")

    def run(self, words, output=None, ok=(0,)):
        """Runs a program; returns its stdout, CPU seconds and peak memory in MB."""
        out_path = output or os.path.join(self.work, "stdout")
        error_path = os.path.join(self.work, "stderr")
        env = dict(os.environ, QT_QPA_PLATFORM="offscreen")
        with open(out_path, "wb") as out, open(error_path, "wb") as error:
            process = subprocess.Popen(words, stdout=out, stderr=error, env=env)
            _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        with open(error_path, encoding="utf-8", errors="replace") as file:
            complaint = file.read()
        if process.returncode not in ok:
            raise subprocess.CalledProcessError(process.returncode, words, stderr=complaint)
        text = ""
        if output is None:
            with open(out_path, encoding="utf-8", errors="replace") as file:
                text = file.read()
        return text, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024

    def tarsier(self, *words, ok=(0, 1)):
        text, seconds, memory = self.run([self.program, *words], ok=ok)
        return [json.loads(line) for line in text.splitlines() if line.startswith("{")], seconds, memory

    # --- structure from motion ---

    def sfm_row(self, name, method, model, truth, seconds, memory):
        line = self.tarsier("sfm", "eval", model, "--truth", truth, "--json")[0][0]
        known = json.dumps({k: v for k, v in line.items() if not isinstance(v, (dict, list))})
        self.add("sfm", name, method, known, f"{seconds:.0f} CPU s, {memory:.0f} MB", line)

    def sfm(self):
        for name in ("sfm-fountain-P11", "sfm-Herz-Jesu-P8"):
            try:
                folder = self.needs(name)
            except Skip as why:
                self.skipped("sfm", name, why)
                continue
            self.attempt("sfm", "tarsier", self.sfm_tarsier, name, folder)
            self.attempt("sfm", "COLMAP", self.sfm_colmap, name, folder)

    def sfm_tarsier(self, name, folder):
        out = self.folder(name, "tarsier")
        _, seconds, memory = self.tarsier("sfm", "reconstruct", os.path.join(folder, "images"), "--camera-file",
                                          os.path.join(folder, "K.txt"), "-o", out, "--quiet")
        self.sfm_row(name, self.version, out, os.path.join(folder, "gt.jsonl"), seconds, memory)

    def sfm_colmap(self, name, folder):
        colmap = shutil.which("colmap")
        if not colmap:
            raise Skip("apt-get install colmap")
        out = self.folder(name, "colmap")
        database, images = os.path.join(out, "db"), os.path.join(folder, "images")
        with open(os.path.join(folder, "K.txt"), encoding="utf-8") as file:
            k = [[float(word) for word in line.split()] for line in file if line.strip()]
        # COLMAP's pixel centres lie at one half.
        camera = f"{k[0][0]},{k[1][1]},{k[0][2] + 0.5},{k[1][2] + 0.5}"
        model = os.path.join(out, "0")
        seconds, memory = 0.0, 0.0
        for words in (
            ["feature_extractor", "--database_path", database, "--image_path", images, "--ImageReader.single_camera", "1",
             "--ImageReader.camera_model", "PINHOLE", "--ImageReader.camera_params", camera, "--SiftExtraction.use_gpu", "0"],
            ["exhaustive_matcher", "--database_path", database, "--SiftMatching.use_gpu", "0"],
            ["mapper", "--database_path", database, "--image_path", images, "--output_path", out,
             "--Mapper.ba_refine_focal_length", "0", "--Mapper.ba_refine_principal_point", "0", "--Mapper.ba_refine_extra_params", "0"],
        ):
            _, one, peak = self.run([colmap, *words])
            seconds, memory = seconds + one, max(memory, peak)
        self.run([colmap, "model_converter", "--input_path", model, "--output_path", model, "--output_type", "TXT"])
        self.sfm_row(name, f"COLMAP {debian_version('colmap')} (Debian), CPU, camera known", model,
                     os.path.join(folder, "gt.jsonl"), seconds, memory)

    # --- dense reconstruction ---

    def dense(self):
        for content in ("relief", "boxes", "room", "thin"):
            self.attempt("dense", "tarsier", self.dense_scene, content)
        self.attempt("dense", "tarsier", self.dense_fountain)

    def dense_row(self, files, method, out, truth, line, seconds, memory):
        """Evaluates one method's cloud where the true surface is known. `line`: the method's output."""
        result, figures = f"{line['points']} points", dict(line)
        if truth:
            scores = self.tarsier("sfm", "eval", out, "--dense", "--truth", truth, "--json")[0][0]
            at_half = next(one for one in scores["cloud"] if one["threshold"] == 0.005)
            known = sum(image["known"] for image in scores["images"]) / len(scores["images"])
            result = (f"F1 {at_half['f1']:.3f} (accuracy {at_half['accuracy']:.3f}, completeness {at_half['completeness']:.3f}) at 0.5 % of the "
                      f"extent, median depth error {100 * scores['depth_median']:.3f} %, depth in {100 * known:.0f} % of the pixels")
            figures["scores"] = scores
        count = line["images"] if isinstance(line["images"], int) else len(line["images"])
        self.add("dense", files, method, result, f"{seconds / count:.1f} CPU s an image, {memory:.0f} MB", figures)

    def dense_methods(self, files, key, model, images, truth):
        out = self.folder(key, "dense")
        lines, seconds, memory = self.tarsier("sfm", "dense", model, "--images", images, "-o", out, "--threads", "1", "--json", "--quiet")
        self.dense_row(files, self.version, out, truth, lines[0], seconds, memory)
        try:
            program = self.peer("tarsier_peer_sgm", "libopencv-dev")
        except Skip as why:
            self.skipped("dense", "OpenCV", why)
            return
        other = self.folder(key, "sgm")
        text, _, memory = self.run([program, out, other])
        line = json.loads(text)
        self.dense_row(files, f"OpenCV {line['opencv']}, StereoSGBM on rectified pairs, fused alike (matching alone)", other, truth, line, line["cpu_seconds"], memory)

    def dense_scene(self, content):
        scene = self.folder("dense-" + content, "scene")
        self.tarsier("sfm", "synth", "-o", scene, "--content", content, "--size", "1536x1024", "--depth", "--quiet")
        self.dense_methods(f"drawn scene: {content}, 8 images of 1536x1024", "dense-" + content, os.path.join(scene, "truth/sparse"),
                           os.path.join(scene, "images"), os.path.join(scene, "truth"))

    def dense_fountain(self):
        folder = self.needs("sfm-fountain-P11")
        model, images = self.folder("dense-fountain", "model"), os.path.join(folder, "images")
        self.tarsier("sfm", "reconstruct", images, "--camera-file", os.path.join(folder, "K.txt"), "-o", model, "--quiet")
        self.dense_methods("sfm-fountain-P11", "dense-fountain", model, images, None)

    # --- markers and image targets ---

    def ar_row(self, area, files, method, lines, seconds=None):
        images = sum(line["images"] for line in lines if line["set"] != "all")
        for line in lines:
            if line["set"] == "all":
                continue
            cost = f"{number(line['ms_median'], 1)} ms" if seconds is None else f"{1e3 * seconds / images:.1f} ms an image, reading it included"
            found = round(line["recall"] * line["truth"])
            self.add(area, f"{files}, {line['set']}" if area == "markers" else files, method,
                     f"recall {share_text(found, line['truth'])}, {line['wrong']} wrong, corners {number(line['corner_rmse_median'], 3)} px "
                     f"(95 %: {number(line['corner_rmse_p95'], 2)}), rotation {number(line['rot_deg_median'], 2)} degrees, "
                     f"flips {number(line['flips_pct'], 1)} %", cost, line)

    def ar_tarsier(self, area, files, truth):
        # Its own "ms" is wall-clock time, which includes other work on the machine.
        lines, seconds, _ = self.tarsier("ar", "eval", truth, "--threads", "1", "--json")
        self.ar_row(area, files, self.version, lines, seconds)

    def judged(self, area, files, truth, method, lines, *more):
        path = os.path.join(self.work, "results.jsonl")
        with open(path, "w", encoding="utf-8") as file:
            file.writelines(json.dumps(line) + "\n" for line in lines)
        self.ar_row(area, files, method, self.tarsier("ar", "eval", truth, "--results", path, "--json", *more)[0])

    @staticmethod
    def truth_lines(path):
        with open(path, encoding="utf-8") as file:
            for text in file:
                line = json.loads(text)
                gray = cv2.imread(os.path.join(os.path.dirname(path), line["image"]), cv2.IMREAD_GRAYSCALE) if cv2 else None
                if cv2 is not None and gray is None:
                    raise Skip(f"{line['image']} cannot be read")
                yield line, gray

    def markers(self):
        try:
            truth = self.needs("ar/markers.jsonl")
        except Skip as why:
            self.skipped("markers", "all methods", why)
            return
        files = "ar/markers.jsonl"
        self.attempt("markers", "tarsier", self.ar_tarsier, "markers", files, truth)
        self.attempt("markers", "cv::aruco", self.markers_opencv, files, truth)
        self.attempt("markers", "AprilTag 3", self.markers_apriltag, files, truth)

    def markers_opencv(self, files, truth):
        version = self.opencv("aruco")
        names = {"orig": "DICT_ARUCO_ORIGINAL", "aruco-original": "DICT_ARUCO_ORIGINAL", "6x6": "DICT_6X6_250", "6x6_250": "DICT_6X6_250",
                 "36h11": "DICT_APRILTAG_36h11", "tag36h11": "DICT_APRILTAG_36h11"}
        parameters = cv2.aruco.DetectorParameters_create() if hasattr(cv2.aruco, "DetectorParameters_create") else cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        results = []
        for line, gray in self.truth_lines(truth):
            if line["family"] not in names:
                continue
            code = getattr(cv2.aruco, names[line["family"]])
            dictionary = cv2.aruco.Dictionary_get(code) if hasattr(cv2.aruco, "Dictionary_get") else cv2.aruco.getPredefinedDictionary(code)
            k = np.array(line["K"], float).reshape(3, 3)
            start = time.thread_time()
            if hasattr(cv2.aruco, "ArucoDetector"):
                corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(gray)
            else:
                corners, ids, _ = cv2.aruco.detectMarkers(gray, dictionary, parameters=parameters)
            markers = []
            half = line["size"] / 2
            square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
            for one, id_ in zip(corners, ids.ravel() if ids is not None else []):
                _, rvec, tvec = cv2.solvePnP(square, one.reshape(4, 2).astype(float), k, np.array(line["dist"], float), flags=cv2.SOLVEPNP_IPPE_SQUARE)
                markers.append({"id": int(id_), "corners": one.reshape(4, 2).astype(float).tolist(), "rvec": rvec.ravel().tolist(),
                                "tvec": tvec.ravel().tolist()})
            results.append({"image": line["image"], "markers": markers, "ms": 1e3 * (time.thread_time() - start)})
        self.judged("markers", files, truth, f"{version}, cv::aruco, sub-pixel corners, poses by IPPE", results)

    def markers_apriltag(self, files, truth):
        program = self.peer("tarsier_peer_apriltag", "libapriltag-dev")
        for decimate in ("1", "2"):
            text, _, _ = self.run([program, truth, decimate])
            lines = [json.loads(line) for line in text.splitlines()]
            if not lines:
                raise Skip("the set has no markers of 36h11")
            self.judged("markers", files, truth, f"AprilTag {debian_version('libapriltag-dev')} (Debian), quad_decimate {decimate}", lines,
                        "--family", "36h11")

    def planar(self):
        try:
            truth = self.needs("ar/planar.jsonl")
        except Skip as why:
            self.skipped("planar", "all methods", why)
            return
        files = "ar/planar.jsonl"
        self.attempt("planar", "tarsier", self.ar_tarsier, "planar", files, truth)
        self.attempt("planar", "SIFT", self.planar_features, files, truth, "SIFT")
        self.attempt("planar", "ORB", self.planar_features, files, truth, "ORB")

    def planar_features(self, files, truth, name):
        version = self.opencv()
        cv2.setNumThreads(1)
        features = cv2.SIFT_create(1500) if name == "SIFT" else cv2.ORB_create(1500)
        matcher = cv2.BFMatcher(cv2.NORM_L2 if name == "SIFT" else cv2.NORM_HAMMING)
        ratio = 0.75 if name == "SIFT" else 0.8
        targets = {}
        results = []
        for line, gray in self.truth_lines(truth):
            if line["target"] not in targets:
                image = cv2.imread(os.path.join(os.path.dirname(truth), line["target"]), cv2.IMREAD_GRAYSCALE)
                targets[line["target"]] = (image.shape, *features.detectAndCompute(image, None))
            (height, width), points, descriptors = targets[line["target"]]
            start = time.thread_time()
            seen, found = features.detectAndCompute(gray, None)
            markers = []
            pairs = matcher.knnMatch(found, descriptors, k=2) if found is not None and len(found) > 1 else []
            good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < ratio * p[1].distance]
            if len(good) >= 8:
                h, inliers = cv2.findHomography(np.float32([points[m.trainIdx].pt for m in good]), np.float32([seen[m.queryIdx].pt for m in good]),
                                                cv2.RANSAC, 3, maxIters=2000)
                if h is not None and int(inliers.sum()) >= 10:
                    border = np.float32([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
                    corners = cv2.perspectiveTransform(border[None], h)[0]
                    if cv2.isContourConvex(corners):
                        x, y = line["size"] / 2, line["size"] / 2 * height / width
                        _, rvec, tvec = cv2.solvePnP(np.array([[-x, y, 0], [x, y, 0], [x, -y, 0], [-x, -y, 0]]), corners.astype(float),
                                                     np.array(line["K"], float).reshape(3, 3), np.array(line["dist"], float), flags=cv2.SOLVEPNP_IPPE)
                        markers.append({"id": 0, "corners": corners.astype(float).tolist(), "rvec": rvec.ravel().tolist(), "tvec": tvec.ravel().tolist()})
            results.append({"image": line["image"], "markers": markers, "ms": 1e3 * (time.thread_time() - start)})
        self.judged("planar", files, truth, f"{version}, {name} (1500), ratio {ratio}, RANSAC 3 px", results)

    # --- people ---

    def people(self):
        for name, size, trainings in (("orl", None, (5,)), ("yale-b-cropped", (42, 48), (5, 15))):
            try:
                faces = self.faces_of(self.needs(name))
            except Skip as why:
                self.skipped("people", name, why)
                continue
            for training in trainings:
                files = f"{name}, {training} images of each person train" + (f", {size[0]}x{size[1]}" if size else "")
                self.attempt("people", "tarsier", self.people_tarsier, files, faces, size, training)
                self.attempt("people", "cv::face", self.people_opencv, files, faces, size, training)

    @staticmethod
    def faces_of(folder):
        out = []
        for person in sorted(os.listdir(folder)):
            inside = os.path.join(folder, person)
            if os.path.isdir(inside):
                out += [(os.path.join(inside, name), person) for name in sorted(os.listdir(inside)) if name.endswith((".pgm", ".png", ".jpg"))]
        if not out:
            raise Skip(f"no images in folders of people in {folder}")
        return out

    def people_tarsier(self, files, faces, size, training):
        path = os.path.join(self.work, "faces.lst")
        with open(path, "w", encoding="utf-8") as file:
            file.writelines(f"{image}\t{person}\n" for image, person in faces)
        words = ["people", "eval", path, "--raw", "-k", str(training), "--json", *(["--size", f"{size[0]}x{size[1]}"] if size else [])]
        lines, seconds, _ = self.tarsier(*words)
        for line in lines:
            identified = line["identified"]
            self.add("people", files, f"{self.version}, {line['algorithm']}",
                     f"identified {identified['rate']:.3f} ({identified['hits']} of {identified['trials']} in {identified['draws']} draws; "
                     f"{identified['low']:.2f} to {identified['high']:.2f}), true accepts at 1 % false ones {line['tar']:.2f}",
                     f"{line['identify_ms']:.1f} ms", line)

    def people_opencv(self, files, faces, size, training):
        version = self.opencv("face")
        cv2.setNumThreads(1)
        people = sorted({person for _, person in faces})
        images = []
        for path, _ in faces:
            gray = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
            images.append(cv2.resize(gray, size, interpolation=cv2.INTER_LINEAR) if size else gray)
        labels = [people.index(person) for _, person in faces]
        of_person = {p: [i for i, label in enumerate(labels) if label == p] for p in range(len(people))}

        def split(seed, enrolled):  # the split of `people eval`
            draw = np.random.RandomState(seed)
            train = []
            for p in range(len(people)):
                order = draw.permutation(len(of_person[p]))
                if p in enrolled:
                    train += [of_person[p][i] for i in order[:training]]
            return train, sorted(set(range(len(images))) - set(train))

        for name, make in (("Eigenfaces", cv2.face.EigenFaceRecognizer_create), ("Fisherfaces", cv2.face.FisherFaceRecognizer_create),
                           ("LBPH", cv2.face.LBPHFaceRecognizer_create)):
            right = asked = 0
            accepts, ms = [], []
            for seed in range(5):
                train, probes = split(seed, set(range(len(people))))
                model = make()
                model.train([images[i] for i in train], np.array([labels[i] for i in train]))
                start = time.thread_time()
                right += sum(model.predict(images[i])[0] == labels[i] for i in probes)
                ms.append(1e3 * (time.thread_time() - start) / len(probes))
                asked += len(probes)
                enrolled = set(np.random.RandomState(seed + 1000).permutation(len(people))[: len(people) // 2].tolist())
                train, probes = split(seed, enrolled)
                model = make()
                model.train([images[i] for i in train], np.array([labels[i] for i in train]))
                scores = [(labels[i] in enrolled, -model.predict(images[i])[1]) for i in probes]
                known = np.array([s for inside, s in scores if inside])
                strangers = np.array([s for inside, s in scores if not inside])
                thresholds = [*np.unique(np.concatenate([known, strangers])), np.inf]
                threshold = next(t for t in thresholds if np.mean(strangers >= t) <= 0.01)
                accepts.append(float(np.mean(known >= threshold)))
            low, high = wilson(right / 5, asked / 5)
            self.add("people", files, f"{version}, cv::face {name}",
                     f"identified {right / asked:.3f} ({right} of {asked} in 5 draws; {low:.2f} to {high:.2f}), "
                     f"true accepts at 1 % false ones {np.mean(accepts):.2f}", f"{np.mean(ms):.1f} ms",
                     {"identified": {"hits": right, "trials": asked, "draws": 5, "low": low, "high": high}, "tar": float(np.mean(accepts)),
                      "identify_ms": float(np.mean(ms))})

    # --- landmarks of faces ---

    def landmarks(self):
        self.attempt("landmarks", "faces68", self.landmarks_split)
        self.attempt("landmarks", "imm-frontal", self.landmarks_imm)

    def boxes_of(self, images):
        """The starts of `landmarks fit`: the box of the widest face in each image, for all methods alike."""
        listed = os.path.join(self.work, "images.txt")
        with open(listed, "w", encoding="utf-8") as file:
            file.writelines(os.path.abspath(image) + "\n" for image in images)
        boxes, fits = {}, []
        for line in self.tarsier("landmarks", "fit", "@" + listed, "--json", "--quiet", "-o", "none")[0]:
            fits.append(line)
            faces = line.get("faces") or []
            if faces:
                boxes[os.path.realpath(line["image"])] = max(faces, key=lambda face: face["box"][2])["box"]
        return boxes, fits

    @staticmethod
    def points_of(path):
        with open(path, encoding="utf-8") as file:
            values = [float(word) for word in file.read().split("{")[1].split("}")[0].split()]
        return np.array(values).reshape(-1, 2)

    def landmarks_split(self):
        self.opencv()
        folder = self.needs("faces68")
        listed = os.path.join(folder, "frontal.txt")
        with open(listed, encoding="utf-8") as file:
            names = [line.strip() for line in file if line.strip()]
        files = f"faces68/frontal.txt, every third of {len(names)} tests"
        held = os.path.join(self.work, "held.json")

        def own():
            _, seconds, _ = self.tarsier("landmarks", "train", "tracker", listed, "--hold-out", "3", "--mirror", "-o", held, "--quiet")
            line = self.tarsier("landmarks", "eval", listed, "--held-out", "3", "--model", held, "--json")[0][0]
            self.landmark_row(files, f"{self.version}, trees and descent", line, f"trained in {seconds:.0f} CPU s")

        self.attempt("landmarks", "tarsier", own)
        program = self.peer("tarsier_peer_dlib", "libdlib-dev")
        version = self.run([program, "version"])[0].strip()
        boxes, _ = self.boxes_of([os.path.join(folder, name) for name in names])
        truth = {name: self.points_of(os.path.join(folder, name.rsplit(".", 1)[0] + ".pts")) for name in names}
        mirror = [*range(16, -1, -1), *range(26, 16, -1), 27, 28, 29, 30, 35, 34, 33, 32, 31, 45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40,
                  *range(54, 47, -1), 59, 58, 57, 56, 55, 64, 63, 62, 61, 60, 67, 66, 65]
        # A box that misses the face, or no box, is replaced by one at the usual place relative to the face.
        right = {}
        for name in names:
            box, points = boxes.get(os.path.realpath(os.path.join(folder, name))), truth[name]
            middle, size = points.mean(0), np.sqrt(((points - points.mean(0)) ** 2).sum(1).mean())
            if box and abs(box[0] + box[2] / 2 - middle[0]) < size and abs(box[1] + box[3] / 2 - middle[1]) < size:
                right[name] = ((np.array(box[:2]) + np.array(box[2:]) / 2 - middle) / size, box[2] / size)
        offset = np.median([value[0] for value in right.values()], axis=0)
        width = float(np.median([value[1] for value in right.values()]))
        training, tests = os.path.join(self.work, "train.jsonl"), os.path.join(self.work, "test.jsonl")
        images = self.folder("mirrored")
        with open(training, "w", encoding="utf-8") as train, open(tests, "w", encoding="utf-8") as test:
            for k, name in enumerate(names, 1):
                image, points = os.path.abspath(os.path.join(folder, name)), truth[name]
                box = boxes.get(os.path.realpath(image))
                if k % 3 == 0:
                    test.write(json.dumps({"image": image, "box": box}) + "\n")
                    continue
                if name not in right:
                    size = np.sqrt(((points - points.mean(0)) ** 2).sum(1).mean())
                    corner = points.mean(0) + offset * size - width * size / 2
                    box = [float(corner[0]), float(corner[1]), width * size, width * size]
                train.write(json.dumps({"image": image, "box": box, "points": points.tolist()}) + "\n")
                gray = cv2.imread(image, cv2.IMREAD_GRAYSCALE)
                turned = os.path.join(images, os.path.basename(name).rsplit(".", 1)[0] + ".png")
                cv2.imwrite(turned, cv2.flip(gray, 1))
                flipped = points[mirror].copy()
                flipped[:, 0] = gray.shape[1] - 1 - flipped[:, 0]
                train.write(json.dumps({"image": turned, "box": [gray.shape[1] - box[0] - box[2], *box[1:]], "points": flipped.tolist()}) + "\n")
        model, results = os.path.join(self.work, "dlib.dat"), os.path.join(self.work, "dlib.jsonl")
        trees, oversampling = str(self.flags.trees), str(self.flags.oversampling)
        _, seconds, _ = self.run([program, "train", training, model, trees, oversampling, "1"])
        self.run([program, "fit", model, tests], output=results)
        line = self.tarsier("landmarks", "eval", listed, "--held-out", "3", "--results", results, "--json")[0][0]
        with open(results, encoding="utf-8") as file:
            ms = [json.loads(text).get("ms") for text in file]
        line["ms"] = float(np.median([value for value in ms if value is not None]))
        self.landmark_row(files, f"dlib {version}, trees (10 x {trees}, {oversampling} starts a face, mirrored faces too), Tarsier's boxes", line,
                          f"trained in {seconds:.0f} CPU s")

    def landmark_row(self, files, method, line, cost):
        failures = round(line["failures"] * line["faces"])
        self.add("landmarks", files, method,
                 f"error mean {line['nme_mean']:.2f} %, median {line['nme_median']:.2f} %; failures {share_text(failures, line['faces'])}, of them "
                 f"{line['missed']} not found, {line['wrong']} another face", f"{line.get('ms', 0):.2f} ms; {cost}", line)

    # The points that the 73 of IMM and the 68 of 300-W have in common: corners of the eyes, nose tip and base, corners and middles of the
    # lips. Outline, brows and eyelids have different places in the two markups.
    SHARED = {"eyes": [(36, 16), (39, 20), (42, 28), (45, 24)], "nose": [(30, 45), (33, 39)],
              "mouth": [(48, 46), (50, 48), (51, 49), (52, 50), (54, 52), (57, 54), (62, 57), (66, 60)]}

    # The same points of MediaPipe's mesh, by 300-W's numbers. MediaPipe's own names (MESH_ANNOTATIONS of its TensorFlow.js models) put the
    # nose tip at 1. Published lists of the 68 use 4, which is at the place of both markups.
    MESH = {36: 33, 39: 133, 42: 362, 45: 263, 30: 4, 33: 2, 48: 61, 50: 37, 51: 0, 52: 267, 54: 291, 57: 17, 62: 13, 66: 14}

    def landmarks_imm(self):
        self.opencv()
        folder = self.needs("imm-frontal")
        pairs = [pair for part in self.SHARED.values() for pair in part]
        truth = {}
        for name in sorted(os.listdir(folder)):
            if not name.endswith(".asf"):
                continue
            image = os.path.join(folder, name[:-4] + ".jpg")
            shape = cv2.imread(image).shape
            with open(os.path.join(folder, name), encoding="latin-1") as file:
                rows = [line.split() for line in file if line.strip() and line[0] != "#"]
            truth[os.path.realpath(image)] = np.array([[float(r[2]) * shape[1], float(r[3]) * shape[0]] for r in rows if len(r) >= 7])
        files = f"imm-frontal ({len(truth)} images of 6 people), the {len(pairs)} points that both markups have"

        def judge(method, lines, cost, size):
            """`lines`: the detections of a method. Its points are the 68 of 300-W, or are given by their numbers there, {36: [x, y] ..}."""
            offsets, missed = [], 0
            found = {}
            for line in lines:
                faces = line.get("faces") or []
                points = line.get("points") or (max(faces, key=lambda f: f["box"][2])["points"] if faces else None)
                if points:
                    found[os.path.realpath(line["image"])] = np.array([points[a] for a, _ in pairs])
            for image, points in truth.items():
                unit = np.linalg.norm(points[16] - points[24])
                expected, got = points[[b for _, b in pairs]], found.get(image)
                if got is None or np.linalg.norm(got.mean(0) - expected.mean(0)) > unit:
                    missed += 1
                    continue
                offsets.append(100 * (got - expected) / unit)
            if not offsets:
                raise Skip("it finds no face in any image")
            offsets = np.array(offsets)
            errors = np.linalg.norm(offsets, axis=2)
            steady = np.linalg.norm(offsets - offsets.mean(0), axis=2)
            failures = missed + int((errors.mean(1) > 8).sum())
            part, at = [], 0
            for name, of in self.SHARED.items():
                part.append(f"{name} {errors[:, at:at + len(of)].mean():.2f}")
                at += len(of)
            self.add("landmarks", files, method,
                     f"error mean {errors.mean():.2f} %, median over images {np.median(errors.mean(1)):.2f} % ({', '.join(part)}); about each point's own "
                     f"mean offset, which the markups differ by, {steady.mean():.2f} %; failures (above 8 %, or not found) {share_text(failures, len(truth))}",
                     f"{cost}; {size / 1e6:.2g} MB" if size < 1e7 else f"{cost}; {size / 1e6:.0f} MB",
                     {"faces": len(truth), "missed": missed, "failures": failures, "nme_mean": float(errors.mean()),
                      "nme_median": float(np.median(errors.mean(1))), "nme_steady": float(steady.mean()), "model_bytes": size})

        images = list(truth)

        def own():
            _, lines = self.boxes_of(images)
            judge(f"{self.version}, landmarks68 as it ships", lines, f"{np.median([line['ms'] for line in lines]):.1f} ms with the search",
                  os.path.getsize(os.path.join(ROOT, "models", "landmarks68.json")))

        def dlib():
            program = self.peer("tarsier_peer_dlib", "libdlib-dev")
            version = self.run([program, "version"])[0].strip()
            model = "/usr/share/dlib/shape_predictor_68_face_landmarks.dat"
            if not os.path.exists(model):
                raise Skip("apt-get install libdlib-data (dlib's own model of 68 points)")
            boxes, _ = self.boxes_of(images)
            listed = os.path.join(self.work, "imm.jsonl")
            with open(listed, "w", encoding="utf-8") as file:
                file.writelines(json.dumps({"image": image, "box": boxes.get(image)}) + "\n" for image in images)
            for verb, start in (("find", "its own detector"), ("fit", "Tarsier's boxes")):
                text, _, _ = self.run([program, verb, model, listed])
                lines = [json.loads(line) for line in text.splitlines()]
                ms = [line["ms"] for line in lines if "ms" in line]
                judge(f"dlib {version}, model of libdlib-data {debian_version('libdlib-data')}, {start}", lines, f"{np.median(ms):.1f} ms a fit",
                      os.path.getsize(model))

        def face_api(kind, weights):
            folder, version = self.package("@vladmandic/face-api")
            plain = {}
            for image in images:
                plain[os.path.join(self.folder("imm"), os.path.basename(image)[:-4] + ".ppm")] = image
            for path, image in plain.items():
                cv2.imwrite(path, cv2.imread(image))
            lines = self.node("face_points.mjs", folder, kind, *plain)
            for line in lines:
                line["image"] = plain[line["image"]]
            judge(f"@vladmandic/face-api {version}, {weights}, its own detector", lines,
                  f"{np.median([line['fit_ms'] for line in lines]):.0f} ms a fit in plain JavaScript, {np.median([line['ms'] for line in lines]):.0f} with the search",
                  os.path.getsize(os.path.join(folder, "model", f"{weights}_model.bin")))

        def mesh(kind, weights):
            folder, version = self.package("@mediapipe/face_mesh")
            lines = self.node("face_mesh.mjs", folder, kind, *images)
            for line in lines:
                if line.get("points"):
                    line["points"] = {at: line["points"][of] for at, of in self.MESH.items()}
            with open(os.path.join(folder, "face_mesh_solution_packed_assets_loader.js"), encoding="utf-8") as file:
                place = re.search(weights + r'\.tflite",\s*"start":\s*(\d+),\s*"end":\s*(\d+)', file.read())
            judge(f"MediaPipe, @mediapipe/face_mesh {version} in Chromium, {weights}, its own detector", lines,
                  f"{np.median([line['ms'] for line in lines]):.0f} ms by the clock with the search, WebGL in software", int(place[2]) - int(place[1]))

        self.attempt("landmarks", "tarsier", own)
        self.attempt("landmarks", "dlib", dlib)
        self.attempt("landmarks", "face-api", face_api, "normal", "face_landmark_68")
        self.attempt("landmarks", "face-api, tiny", face_api, "tiny", "face_landmark_68_tiny")
        self.attempt("landmarks", "MediaPipe", mesh, "plain", "face_landmark")
        self.attempt("landmarks", "MediaPipe, attention", mesh, "attention", "face_landmark_with_attention")

    def node(self, script, *words):
        text, _, _ = self.run(["node", os.path.join(ROOT, "bench", "peers", script), *words])
        return [json.loads(line) for line in text.splitlines()]

    # --- poses ---

    def posit(self):
        self.attempt("posit", "tarsier bench posit", self.posit_study)

    def posit_study(self):
        version = cv2.__version__ if cv2 is not None else debian_version("libopencv-calib3d406")
        for line in self.tarsier("bench", "posit", "--json")[0]:
            if line["noise_px"] != 1:
                continue
            own = line["method"] != "sqpnp"
            self.add("posit", "2000 simulated heads, 1 px noise (bench posit)", f"{self.version}, {line['method']}" if own else f"OpenCV {version}, SQPNP",
                     f"rotation {line['rotation_deg']:.3f} degrees, translation {line['translation_mm']:.2f} mm, {line['failures']} failures",
                     f"{line['us']:.0f} us", line)

    def plates(self):
        pass  # only reference figures

    def table(self):
        # The present load: other work on the machine.
        load = os.getloadavg()
        lines = [f"Processor: {processor()}. {self.version}. Load {load[0]:.1f} at the end, {self.load:.1f} at the beginning: times are of "
                 "processor time, so upper bounds where other work ran. Intervals: Wilson, 95 %; over several draws, by the probes of one.", "",
                 "| Area | Files | Method | Result | Cost |", "|---|---|---|---|---|"]
        for row in self.rows:
            mark = {"measured": "", "skipped": "", "reference": "**reference, not run here:** "}[row["state"]]
            lines.append(f"| {row['area']} | {row['files']} | {row['method']} | {mark}{row['result']} | {row['cost']} |")
        return "\n".join(lines) + "\n"


AREAS = ["sfm", "dense", "markers", "planar", "people", "landmarks", "posit", "plates"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default=os.path.join(ROOT, "build/release/bin/tarsier"))
    parser.add_argument("--data", default=os.environ.get("TARSIER_DATA") or os.path.join(ROOT, "../shared/data"))
    parser.add_argument("--out", help="folder for peers.md and peers.json")
    parser.add_argument("--only", default=",".join(AREAS), help="some of " + ",".join(AREAS))
    parser.add_argument("--npm", default=os.path.join(ROOT, "build/peers"), help="where npm installed its packages (--prefix)")
    parser.add_argument("--trees", type=int, default=500, help="of dlib, in each of 10 cascades (its default)")
    parser.add_argument("--oversampling", type=int, default=20, help="of dlib, starts a face (its default)")
    flags = parser.parse_args()
    areas = flags.only.split(",")
    unknown = [area for area in areas if area not in AREAS]
    if unknown:
        parser.error(f"--only {unknown[0]}: there are {', '.join(AREAS)}")
    if not os.access(flags.program, os.X_OK):
        sys.exit(f"run.py: no program {flags.program}: build it, or name it by --program")
    flags.program = os.path.abspath(flags.program)
    if flags.out:
        os.makedirs(flags.out, exist_ok=True)
    if cv2 is not None:
        cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as work:
        bench = Bench(flags, work)
        bench.load = os.getloadavg()[0]
        bench.version = bench.run([flags.program, "--version"])[0].strip()
        for area in areas:
            getattr(bench, area)()
            for name, files, method, result, cost in REFERENCES:
                if name == area:
                    bench.add(name, files, method, result, cost, state="reference")
    table = bench.table()
    print(table, end="")
    if flags.out:
        with open(os.path.join(flags.out, "peers.md"), "w", encoding="utf-8") as file:
            file.write(table)
        with open(os.path.join(flags.out, "peers.json"), "w", encoding="utf-8") as file:
            json.dump({"processor": processor(), "version": bench.version, "rows": bench.rows}, file, indent=1)
            file.write("\n")
    # A run without measurements is not a success.
    return 0 if any(row["state"] == "measured" for row in bench.rows) else 1


if __name__ == "__main__":
    sys.exit(main())
