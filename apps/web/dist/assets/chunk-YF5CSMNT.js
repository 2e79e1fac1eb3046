import{o as e}from"./chunk-WT4J5QQL.js";async function o(){return(await e()).filter(t=>t.name.endsWith(".points.json"))}var s=t=>`/api/state/${encodeURIComponent(t)}`;export{o as a,s as b};
