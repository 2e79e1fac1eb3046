import{g as e}from"./chunk-KGQBRERF.js";async function o(){return(await e()).filter(t=>t.name.endsWith(".points.json"))}var s=t=>`/api/state/${encodeURIComponent(t)}`;export{o as a,s as b};
