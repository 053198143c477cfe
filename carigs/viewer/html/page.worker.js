"use strict";
// The worker: poses the head, carries the surfels along, colours and sorts them for a camera.

let head, rig, surfels, posedState = "", litState = "";

/** Surfels for a request {place, clip, frame, amounts, turns, level, regions, eye, away}, farthest first, in `request.buffer` if it is given. */
function answer(request) {
  const times = {}, start = performance.now();
  let last = start;
  const lap = (name) => { const now = performance.now(); times[name] = now - last; last = now; };
  const { place, clip, frame, amounts, turns, level, regions } = request;
  const state = JSON.stringify([clip === null ? place : null, clip, frame, amounts, turns, level, regions]);
  if (state !== posedState) {
    const posed = head.pose(request);
    lap("pose");
    rig.move(posed);
    lap("motion");
    surfels.skin();
    lap("skinning");
    head.lit(request);
    lap("light");
    posedState = state;
  }
  surfels.look(request.eye, head.shade);
  lap("colour");
  const order = surfels.order(request.away);
  lap("sort");
  const content = request.buffer ? new Float32Array(request.buffer) : new Float32Array(FLOATS * request.room);
  surfels.gather(order, content);
  lap("gather");
  times.total = performance.now() - start;
  return { id: request.id, count: order.length, content, times };
}

async function receive(message) {
  if (message.header) {
    const { header } = message, data = await unpack(message.data, header.arrays);
    head = new Head(data, header);
    rig = new Rig(data, header, head.template);
    surfels = new Surfels(data, header, rig);
    postMessage({ ready: true, count: surfels.count });
  } else {
    const result = answer(message);
    postMessage(result, [result.content.buffer]);
  }
}

onmessage = (event) => receive(event.data).catch((error) => postMessage({ error: String(error && error.message || error) }));
