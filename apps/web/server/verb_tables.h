// SPDX-License-Identifier: MIT
#pragma once

#include "verb_policy.h"
#include <array>
#include <string_view>

// The meaning of the verbs' flags and inputs for a page: the tables of verb_policy.cpp. A flag is
// searched first among the exceptions of its verb, then by its name. An unlisted flag is refused,
// and verb_policy_test fails for it.
namespace tarsier::web {

// Numbers, switches, choices, and words that the verb never uses as a path.
inline constexpr auto kValueFlags = std::to_array<std::string_view>({
    "--algorithm",
    "--aligner-steps",
    "--angle-weight",
    "--any-quality",
    "--any-weights",
    "--as",
    "--at",
    "--axes",
    "--backend",
    "--blur",
    "--board",
    "--by-person",
    "--c",
    "--challenge",
    "--calibration",
    "--cell",
    "--cells",
    "--channels",
    "--characters",
    "--check",
    "--check-steps",
    "--checkpoint",
    "--classic-reader",
    "--close-holes",
    "--cluster",
    "--cluster-size",
    "--colour-modes",
    "--colour-width",
    "--columns",
    "--components",
    "--confidence-only",
    "--connect-timeout",
    "--content",
    "--contrast",
    "--correct",
    "--cost",
    "--count",
    "--country",
    "--dark-level",
    "--days",
    "--dense",
    "--dense-quality",
    "--depth",
    "--details",
    "--detection",
    "--direction",
    "--disguised",
    "--distance",
    "--distance-mm",
    "--downscale",
    "--dpi",
    "--draw",
    "--drawings",
    "--drop-out",
    "--edit",
    "--edit-amount",
    "--enrolled",
    "--epipolar-px",
    "--epsilon",
    "--errors",
    "--events",
    "--every",
    "--evidence",
    "--evil-axes",
    "--evil-median",
    "--evil-threshold",
    "--exact-ridge",
    "--export",
    "--eyes",
    "--face",
    "--faces",
    "--false-alarms",
    "--false-merges",
    "--family",
    "--far",
    "--features",
    "--find-pixels",
    "--find-threshold",
    "--fit",
    "--fit-same-camera",
    "--focal",
    "--fixed-order",
    "--fixed-poses",
    "--fold",
    "--format",
    "--fps",
    "--frames",
    "--free-penalty",
    "--gamma",
    "--give-up",
    "--group",
    "--groups",
    "--growing",
    "--height",
    "--held-out",
    "--hidden",
    "--hold-out",
    "--hours",
    "--ids",
    "--ignore-exif",
    "--infrared",
    "--iou",
    "--iterations",
    "--jpeg-quality",
    "--keep",
    "--key-motion",
    "--kind",
    "--largest",
    "--leave-out",
    "--lens",
    "--level",
    "--levels",
    "--limit",
    "--log-level",
    "--lost-after",
    "--low",
    "--mapper",
    "--margin",
    "--marker-family",
    "--marker-size",
    "--match-images",
    "--matches",
    "--max-depth",
    "--max-faces",
    "--max-features",
    "--max-frames",
    "--max-markers",
    "--max-samples",
    "--max-side",
    "--memory",
    "--mesh-up",
    "--method",
    "--min-angle",
    "--min-confidence",
    "--min-consistent",
    "--min-correlation",
    "--min-depth",
    "--min-difference",
    "--min-face",
    "--min-faces",
    "--min-markers",
    "--min-part",
    "--min-readings",
    "--min-score",
    "--min-seconds",
    "--min-side",
    "--min-sightings",
    "--min-views",
    "--mirror",
    "--mirrored",
    "--mode",
    "--modes",
    "--near",
    "--nearest",
    "--neurons",
    "--night",
    "--no-cache",
    "--no-colour",
    "--no-detector",
    "--no-identity",
    "--no-refine",
    "--no-shadow",
    "--no-sort",
    "--no-tangential",
    "--noise",
    "--numbers",
    "--observations",
    "--occlude",
    "--offset",
    "--offset-weight",
    "--online",
    "--online-every",
    "--only",
    "--only-start-images",
    "--origin",
    "--outer-eye-mm",
    "--outlier",
    "--outline",
    "--overlap",
    "--page",
    "--paint-diameter",
    "--paint-rounds",
    "--paint-sigma-color",
    "--paint-sigma-space",
    "--parameters",
    "--parked-return-within",
    "--patch",
    "--patch-method",
    "--people",
    "--pepper",
    "--per-image-camera",
    "--person-error",
    "--pipeline",
    "--pitch",
    "--plain",
    "--plate-threshold",
    "--posters",
    "--proposals",
    "--pure-rotation",
    "--quality",
    "--radial",
    "--random",
    "--ratio",
    "--raw",
    "--reference",
    "--refine",
    "--refine-steps",
    "--refresh",
    "--repeats",
    "--reprojection-px",
    "--resume",
    "--return-within",
    "--ridge",
    "--robust",
    "--roi",
    "--roll",
    "--rolled",
    "--scale",
    "--scan-steps",
    "--scatter",
    "--search",
    "--search-every",
    "--search-px",
    "--seed",
    "--seeds",
    "--segment",
    "--sequence",
    "--set",
    "--shape-prior",
    "--shard",
    "--side",
    "--sides",
    "--sighting",
    "--sightings",
    "--sigmas",
    "--since",
    "--size",
    "--sketch-laplacian",
    "--sketch-median",
    "--sketch-threshold",
    "--skin-color",
    "--skin-distance",
    "--skin-edge-threshold",
    "--skin-lower",
    "--skin-style",
    "--skin-upper",
    "--smooth",
    "--smoothing",
    "--splits",
    "--spread",
    "--square",
    "--square-pixels",
    "--stages",
    "--stall",
    "--start",
    "--starts",
    "--steady",
    "--steady-hysteresis",
    "--steady-memory",
    "--steady-motion",
    "--steps",
    "--strict",
    "--task-time",
    "--tasks",
    "--template",
    "--texture",
    "--texture-modes",
    "--texture-variance",
    "--threads",
    "--tilt",
    "--tilt-share",
    "--timings",
    "--to-the-right",
    "--tolerance",
    "--tolerate",
    "--top",
    "--train",
    "--training",
    "--trajectory",
    "--trees",
    "--trials",
    "--tries",
    "--trim",
    "--turned",
    "--turntable",
    "--undo-correction",
    "--until",
    "--upsample",
    "--variance",
    "--video",
    "--views",
    "--voxel",
    "--wait",
    "--wide",
    "--width",
    "--wild",
    "--words",
    "--yaw",
});

// Names, notes, and text that is compared with logged text.
inline constexpr auto kFreeTextFlags =
    std::to_array<std::string_view>({"--distance-between", "--author", "--label", "--name",
                                     "--names", "--note", "--source", "--terms", "--text"});

inline constexpr auto kInputFlags = std::to_array<std::string_view>(
    {"--annotated", "--appearance", "--camera-file",    "--compare",   "--countries-dir",
     "--database",  "--detector",   "--detector-model", "--embedding", "--found",
     "--from",      "--head",       "--image",          "--images",    "--learn-background",
     "--list",      "--mapping",    "--mesh",           "--model",     "--object",
     "--on",        "--pointing",   "--points",         "--positions", "--reader",
     "--results",   "--scenes",     "--start-model",    "--target",    "--train-list",
     "--truth",     "--view",       "--without"});

inline constexpr auto kWordOrInputFlags = std::to_array<std::string_view>(
    {"--align", "--background", "--camera", "--face-detector", "--pairs"});

inline constexpr auto kOutputFlags = std::to_array<std::string_view>(
    {"--cmc", "--convergence", "--crops", "--csv", "--corrections", "--debug-dir", "--grid",
     "--jsonl", "--layout", "--online-view", "--output", "--roc", "--save-dir", "--undistorted"});

inline constexpr auto kStateFlags =
    std::to_array<std::string_view>({"--gallery", "--log", "--watch"});

inline constexpr auto kServerFlags = std::to_array<std::string_view>(
    {"--fullscreen", "--json", "--progress", "--quiet", "--window", "--yes"});

inline constexpr auto kRefusedFlags = std::to_array<std::string_view>({
    "--actions",    // reads stdin
    "--ca-file",    // trust is decided where the source is allowed
    "--config",     // may hold any flag
    "--crops",      // opens the network
    "--crops-dir",  // see --crops
    "--max-crops",
    "--insecure",    // as --ca-file
    "--listen-all",  // opens the network
    "--models-dir",  // any folder
    "--camera-roi",  // for several cameras, which no page reads
    "--camera-fps",
    "--idle",
    "--motion",
    "--motion-hold",
    "--mqtt-ca-file",  // see --publish
    "--mqtt-cert",
    "--mqtt-key",
    "--mqtt-password-file",
    "--mqtt-user",
    "--homeassistant",
    "--outbox",
    "--outbox-events",
    "--publish",           // connects to other machines
    "--own-dir",           // as --models-dir
    "--on-event",          // runs a program
    "--on-event-timeout",  // see --on-event
    "--on-watch",          // see --on-event
    "--token",             // for a server that is not started
    "--token-file",        // any file
});

// Verbs that no page may start, whatever their flags.
inline constexpr auto kRefusedVerbs = std::to_array<std::string_view>({
    "serve",     // this server
    "merge",     // for runs that no page starts
    "hub",       // connects to other machines
    "demo",      // its page consists of files that a browser would run
    "sfm plan",  // for runs that no page starts, like the next four
    "sfm features", "sfm match", "sfm map", "sfm merge",
    "models import",  // writes to the folder where all programs of this user search for models
});

// Verbs for which a flag has another meaning.
struct FlagException {
  std::string_view verb;
  std::string_view flag;
  FlagKind kind;
};
inline constexpr auto kFlagExceptions = std::to_array<FlagException>({
    {"calibrate", "--draw", FlagKind::kOutput},
    {"people groups", "--draw", FlagKind::kOutput},
    {"people list", "--faces", FlagKind::kFreeText},
    {"people list", "--draw", FlagKind::kOutput},
    {"plate log", "--crops", FlagKind::kOutput},  // for other verbs a port that serves them
    {"ar markers", "--board", FlagKind::kInput},
    {"ar target-train", "--draw", FlagKind::kOutput},
    {"pose track", "--draw", FlagKind::kWordOrInput},  // glasses, or an .obj file
    {"aam explore", "--mesh", FlagKind::kValue},
    {"sfm reconstruct", "--mesh", FlagKind::kValue},
    {"sfm mesh", "--view", FlagKind::kOutput},
    {"sfm mesh", "--turntable", FlagKind::kOutput},
    {"sfm mesh", "--page", FlagKind::kOutput},
    {"people show", "--face", FlagKind::kInput},
    {"people show", "--stages", FlagKind::kInput},
    {"sfm synth", "--images", FlagKind::kValue},
    {"sfm eval", "--errors", FlagKind::kOutput},
    {"plate train-reader", "--reader", FlagKind::kValue},
    {"plate sweep", "--reader", FlagKind::kValue},
    {"landmarks train tracker", "--without", FlagKind::kValue},
    {"landmarks train face-detector", "--window", FlagKind::kValue},
});

// Verbs that open a window unless a file is asked for, and that have no other value without a
// window (headless_value). A run or a job has no window, so it needs one of `outputs`. VerbTable
// adds them to the description of the verb, which pages read, too.
struct WindowVerb {
  std::string_view verb;
  std::array<std::string_view, 2> outputs;  // "": none; the verb works only in a window
};
inline constexpr auto kWindowVerbs = std::to_array<WindowVerb>({
    {"aam explore", {"--output", "--grid"}},
    {"landmarks annotate", {}},
    {"landmarks show", {"--output"}},
});

inline constexpr auto kSourceInputs = std::to_array<std::string_view>({
    "aam fit",
    "ar markers",
    "ar target-track",
    "calibrate",
    "cartoon run",
    "landmarks annotate",
    "landmarks fit",
    "landmarks track",
    "people enroll",
    "people identify",
    "people live",
    "people liveness",
    "plate read",
    "pose track",
    "sfm reconstruct",
});

struct InputException {
  std::string_view verb;  // or an area
  std::string_view input;
  InputKind kind;
};
inline constexpr auto kInputExceptions = std::to_array<InputException>({
    {"people enroll", "NAME", InputKind::kFreeText},
    {"people forget", "NAME", InputKind::kFreeText},
    {"people verify", "NAME", InputKind::kFreeText},
    {"people name", "NAME", InputKind::kFreeText},
    {"people name", "GROUP", InputKind::kValue},
    {"people group", "GALLERY", InputKind::kState},
    {"people index", "GALLERY", InputKind::kState},
    {"people correct move", "TO", InputKind::kFreeText},
    {"people correct merge", "FROM", InputKind::kFreeText},
    {"people correct merge", "INTO", InputKind::kFreeText},
    {"people correct split", "FROM", InputKind::kFreeText},
    {"people correct split", "TO", InputKind::kFreeText},
    {"people correct undo", "ID", InputKind::kValue},
    {"models info", "NAME", InputKind::kValue},
    {"models remove", "NAME", InputKind::kValue},
    {"models verify", "NAME", InputKind::kValue},
    {"ar synth", "what", InputKind::kValue},
    {"plate log", "LOG", InputKind::kState},
    {"plate watch add", "LIST", InputKind::kState},
    {"plate watch add", "PLATE", InputKind::kValue},
    {"plate watch list", "LIST", InputKind::kState},
    {"plate watch remove", "LIST", InputKind::kState},
    {"plate watch remove", "PLATE", InputKind::kValue},
    {"plate watch test", "LIST", InputKind::kState},
    {"plate watch test", "TEXT", InputKind::kValue},
});
inline constexpr auto kFileInputs = std::to_array<std::string_view>(
    {"INPUT", "SET", "DATA", "MODEL", "FILE", "LIST", "DENSE", "truth", "image"});

// Added if a page omits them, because their default is outside the workspace.
struct DefaultState {
  std::string_view flag;
  std::string_view reference;
};
inline constexpr auto kDefaultStates = std::to_array<DefaultState>({{"--gallery", "ws:gallery"}});

// Files that several verbs extend: no output may replace them.
inline constexpr auto kSharedState =
    std::to_array<std::string_view>({"gallery", "plates.db", "watch.csv"});

// Verbs that are recorded in the audit log.
struct Audited {
  std::string_view verb;
  std::string_view flag;  // only with this flag, if not empty
  std::string_view event;
};
inline constexpr auto kAudited = std::to_array<Audited>({
    {"people enroll", "", "enrol"},
    {"people live", "", "enrol"},
    {"people forget", "", "forget"},
    {"people export", "", "export"},
    {"people name", "", "enrol"},
    {"people correct not", "", "correct"},
    {"people correct move", "", "correct"},
    {"people correct merge", "", "correct"},
    {"people correct split", "", "correct"},
    {"people correct undo", "", "correct"},
    {"people list", "--keep", "delete"},
    {"plate log", "--keep", "delete"},
    {"models install", "", "model install"},
    {"models remove", "", "model remove"},
    {"plate log", "--csv", "export"},
    {"plate watch add", "", "watch"},
    {"plate watch remove", "", "watch"},
    {"plate log", "--crops", "export"},
    {"plate log", "--corrections", "export"},
    {"plate log", "--correct", "correct"},
    {"plate log", "--undo-correction", "correct"},
});

}  // namespace tarsier::web
