// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace jade::page {

/// The report as one self-contained HTML file, whose content security policy forbids all requests.
/// @param json  the content for front/main.js and front/report.js; its keys: "facts" [text];
///   "headline" {"views", "blurry", "edi", "render"} in dB, or null; "views" and "tests" [{"name",
///   "camera": "train.3", "seen", "pictures": [{"name", "src", "note"}]}], of which "views" also
///   have "events": null or {"bins", "columns", "rows", "cell", "events", "packed"}, a film of
///   signs as run/event_film.h has it, gzip in base64; "evaluation" (eval.json or null);
///   "allocation" (allocation.json); "metrics" (lines of metrics.jsonl); "config" (text); "scene"
///   {"near_plane", "background" [3], "cameras": {"train", "test": [{"name", "seen", "width",
///   "height", "fx", "fy", "cx", "cy", "poses": [rows of camera_from_world, 12 numbers]}]}}, at
///   least one camera.
/// @param spz  the scene from gaussians::encode_spz(); empty: only pictures.
std::string report_page(std::string json, const std::string& spz);

/// Live page: the server of the page (serve/server.h), the only address that the page may contact,
/// renders the scene.
/// @param json  as above, its pictures without "src", and "live" {"id": of this server, "scale":
///   pixels per trained pixel at most, "pausable", "moving": whether its cameras do, "report":
///   where the finished one will be, or "", "sample": x, y, z of some Gaussians, flat}
std::string live_page(const std::string& json);

/// The page of a sweep, whose pictures and reports are files beside it.
/// @param json  the content for front/sweep.js; its keys: "title", "note" (texts); "facts" [text];
///   "finished", "runs_total" (counts); "columns" [{"heading", "meaning"}]; "tables" [{"title",
///   "paper": [bool per column], "rows": [{"title", "block", "cells": [{"text", "best", "gap",
///   "paper": text or null}]}]}]; "rows" [{"name", "title"}] of those that are run; "scenes"
///   [{"name", "views": [{"name", "seen", "truth": path or null}]}]; "runs" [{"row", "scene",
///   "seed", "state", "reason", "report": path or null, "views": {name: {"psnr", "src": path or
///   null}}}]; "remarks" [text].
std::string sweep_page(const std::string& json);

}  // namespace jade::page
