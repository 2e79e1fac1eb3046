import"./chunk-VSDYETHS.js";import{O as e,y as t}from"./chunk-ZJKHKGPO.js";function o(){return t(e,{title:"Reconstruct",text:"This page is being built."})}export{o as Reconstruct};
